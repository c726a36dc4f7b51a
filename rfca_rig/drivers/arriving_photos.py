"""A camera that puts its photos into a folder by itself: tethered, or through its maker's program."""

from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.drivers.photo_folder import pictures_in
from rfca_rig.drivers.picture_file import read_picture
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import BadInput, DeviceError

LOOK_EVERY_S = 0.1


class ArrivingPhotos:
    """Implements `Camera`: the first photo that comes into the folder after the call. What is there before is left alone.

    `host_s` is when the photo was found, somewhat after it was taken.
    """

    def __init__(self, folder: Path, clock: Clock, limit_s: float) -> None:
        """`limit_s` is how long a call waits. Raises BadInput where there is no such folder."""
        self._folder = folder
        self._clock = clock
        self._limit_s = limit_s
        pictures_in(folder)

    def photo(self) -> Photo:
        """Raises DeviceError where none has come within the limit, or none that is whole."""
        before = {file.name for file in pictures_in(self._folder)}
        began_s = self._clock.now_s()
        why = ""
        while self._clock.now_s() - began_s < self._limit_s:
            for file in pictures_in(self._folder):
                if file.name not in before:
                    try:
                        return Photo(read_picture(file), self._clock.now_s(), file.name)
                    except BadInput as error:
                        why = f"; {error}"  # still being written, perhaps
            self._clock.wait_until(self._clock.now_s() + LOOK_EVERY_S)
        raise DeviceError(f"{self._folder}: no new photo came within {self._limit_s:g} s{why}")

    def close(self) -> None:
        """Nothing is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": f"photos arriving in folder {self._folder.name}"}
