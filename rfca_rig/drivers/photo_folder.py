"""Folder of photos in place of a camera: each call returns the next one, sorted by name."""

import re
from pathlib import Path

from rfca_rig.drivers.picture_file import ENDINGS, read_picture, read_picture_time
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import BadInput, DeviceError


def list_photos(folder: Path) -> list[Path]:
    """The pictures in a folder in natural sort order: 9 before 10.

    Raises BadInput if the folder does not exist, or holds no picture.
    """
    found = list_pictures(folder)
    if not found:
        raise BadInput(f"{folder}: holds no picture; expected are files that end in {', '.join(ENDINGS)}")
    return found


def list_pictures(folder: Path) -> list[Path]:
    """Like `list_photos`, for a folder that may still be empty. Raises BadInput if the folder does not exist."""
    try:
        found = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    except OSError as error:
        raise BadInput(f"{folder}: cannot be read: {error.strerror}; name the folder that holds the photos") from None
    return sorted(found, key=_natural_sort_key)


def _natural_sort_key(file: Path) -> tuple[list[tuple[int, str]], str]:
    parts = re.findall(r"[0-9]+|[^0-9]+", file.stem.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], file.name


class PhotoFolder:
    """Implements `Camera`. `host_s` counts from the earliest photo, by Exif time if every photo has one, else by file times.

    The two are never mixed: the clocks of camera and computer differ by more than the duration of a stage.
    """

    def __init__(self, folder: Path) -> None:
        """Raises BadInput if the folder holds no photo."""
        self._folder = folder
        self._files = list_photos(folder)
        self._next = 0
        moments = [read_picture_time(file) for file in self._files]
        self._by_exif = all(moment.from_exif for moment in moments)
        times_s = [
            moment.at.timestamp() if self._by_exif else file.stat().st_mtime for moment, file in zip(moments, self._files, strict=True)
        ]
        self._times_s = [time_s - min(times_s) for time_s in times_s]

    def __len__(self) -> int:
        return len(self._files)

    def photo(self) -> Photo:
        """The next photo (rows, columns, 3) in BGR order.

        Raises DeviceError after the last one, and BadInput for a broken one, which the next call skips.
        """
        if self._next == len(self._files):
            raise DeviceError(f"{self._folder}: no photo after the {self._next} that it holds; add those that are missing")
        at = self._next
        self._next += 1
        return Photo(read_picture(self._files[at]), self._times_s[at], self._files[at].name)

    def close(self) -> None:
        """Does nothing: no file is held open."""

    def identity(self) -> dict[str, str]:
        time_from = "Exif" if self._by_exif else "times of last change"
        return {"camera": f"folder {self._folder.name} of {len(self._files)} photos", "camera_time": time_from}
