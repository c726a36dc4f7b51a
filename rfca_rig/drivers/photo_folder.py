"""A folder of photos in place of a camera: each call hands out the next one, sorted by name."""

import re
from pathlib import Path

from rfca_rig.drivers.picture_file import ENDINGS, moment_of, read_picture
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import BadInput, DeviceError


def photos_in(folder: Path) -> list[Path]:
    """The pictures in a folder, sorted by name with numbers counted as people do: 9 before 10.

    Raises BadInput where there is no such folder, or no picture in it.
    """
    found = pictures_in(folder)
    if not found:
        raise BadInput(f"{folder}: holds no picture; expected are files that end in {', '.join(ENDINGS)}")
    return found


def pictures_in(folder: Path) -> list[Path]:
    """The same of a folder that may hold none yet. Raises BadInput where there is no such folder."""
    try:
        found = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    except OSError as error:
        raise BadInput(f"{folder}: cannot be read: {error.strerror}; name the folder that holds the photos") from None
    return sorted(found, key=_as_people_sort)


def _as_people_sort(file: Path) -> tuple[list[tuple[int, str]], str]:
    parts = re.findall(r"[0-9]+|[^0-9]+", file.stem.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], file.name


class PhotoFolder:
    """Implements `Camera`. `host_s` counts from the earliest photo, by Exif where every photo has it, else by the files' times.

    The two are never mixed: a camera's clock and a computer's differ by more than a stage lasts.
    """

    def __init__(self, folder: Path) -> None:
        """Raises BadInput where the folder holds no photo."""
        self._folder = folder
        self._files = photos_in(folder)
        self._next = 0
        moments = [moment_of(file) for file in self._files]
        self._by_exif = all(moment.from_exif for moment in moments)
        times_s = [
            moment.at.timestamp() if self._by_exif else file.stat().st_mtime for moment, file in zip(moments, self._files, strict=True)
        ]
        self._times_s = [time_s - min(times_s) for time_s in times_s]

    def __len__(self) -> int:
        return len(self._files)

    def photo(self) -> Photo:
        """The next one. Raises DeviceError behind the last, BadInput for one that is broken; that one is passed over next time."""
        if self._next == len(self._files):
            raise DeviceError(f"{self._folder}: no photo after the {self._next} that it holds; add those that are missing")
        at = self._next
        self._next += 1
        return Photo(read_picture(self._files[at]), self._times_s[at], self._files[at].name)

    def close(self) -> None:
        """Nothing is held open."""

    def identity(self) -> dict[str, str]:
        time_from = "Exif" if self._by_exif else "times of last change"
        return {"camera": f"folder {self._folder.name} of {len(self._files)} photos", "camera_time": time_from}
