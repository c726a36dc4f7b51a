"""One photo of a stage, from when it is asked for until it is there, has failed, or has taken too long."""

from rfca_rig.drivers.roles import Photo, Photographer
from rfca_rig.errors import RigError


class PhotoCapture:
    """Looked at from within the control loop: never waits, and never lets the loop wait longer than `limit_s`.

    A camera's error ends its photo, not the run: force and shaft are measured all the same.
    """

    def __init__(self, camera: Photographer | None, now_s: float, limit_s: float) -> None:
        """Asks for the photo; None asks for none."""
        self.photo: Photo | None = None
        self.fault = ""
        self._camera = camera
        self._limit_s = limit_s
        self._ends_s = now_s + limit_s
        if camera is not None:
            self._begin(camera)

    def _begin(self, camera: Photographer) -> None:
        try:
            camera.begin()
        except RigError as error:
            self._end(str(error))

    def is_under_way(self, now_s: float) -> bool:
        """Whether it is worth coming back; afterwards there is `photo`, or `fault` says why not."""
        if self._camera is None:
            return False
        self._look(self._camera, now_s)
        return self._camera is not None

    def _look(self, camera: Photographer, now_s: float) -> None:
        try:
            self.photo = camera.taken()
        except RigError as error:
            self._end(str(error))
        if self.photo is not None:
            self._end("")
        elif not self.fault and now_s >= self._ends_s:
            self._end(f"the camera gave no photo within {self._limit_s:g} s; check its cable and power")

    def _end(self, fault: str) -> None:
        self.fault = fault
        self._camera = None
