"""Camera that stores its photos in a folder itself: tethered, or through the maker's program."""

from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.drivers.photo_folder import list_pictures
from rfca_rig.drivers.picture_file import read_picture
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import BadInput, DeviceError

LOOK_EVERY_S = 0.1


class ArrivingPhotos:
    """Implements `Camera`: returns the first photo that appears in the folder after the call. Older files are ignored.

    `host_s` is the time when the photo was found, somewhat after it was taken.
    """

    def __init__(self, folder: Path, clock: Clock, limit_s: float) -> None:
        """`limit_s` is the longest wait of a call in s. Raises BadInput if the folder does not exist."""
        self._folder = folder
        self._clock = clock
        self._limit_s = limit_s
        list_pictures(folder)

    def photo(self) -> Photo:
        """A photo (rows, columns, 3) in BGR order. Raises DeviceError if no complete one appears within the limit."""
        before = {file.name for file in list_pictures(self._folder)}
        began_s = self._clock.now_s()
        why = ""
        while self._clock.now_s() - began_s < self._limit_s:
            for file in list_pictures(self._folder):
                if file.name not in before:
                    try:
                        return Photo(read_picture(file), self._clock.now_s(), file.name)
                    except BadInput as error:
                        # The file may still be being written, so it is tried again.
                        why = f"; {error}"
            self._clock.wait_until(self._clock.now_s() + LOOK_EVERY_S)
        raise DeviceError(f"{self._folder}: no new photo came within {self._limit_s:g} s{why}")

    def close(self) -> None:
        """Does nothing: no file is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": f"photos arriving in folder {self._folder.name}"}
