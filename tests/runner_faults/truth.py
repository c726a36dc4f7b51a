"""What the shaft really does, and what can be done to it: written down step by step, whatever
the drive says.
"""

from dataclasses import dataclass, field

import numpy as np

from rfca_rig.twins.world import ShaftDrive, ShaftState, TwinPlant

BLOCK_Nm_per_rad = 2e3
BLOCK_Nm_s_per_rad = 20.0
STANDS_RAD_S = 0.05
STANDS_FOR_S = 0.05


@dataclass(frozen=True)
class Moment:
    """The end of one step: the shaft's true motion, and whether the drive gave any torque."""

    at_s: float
    angle_rad: float
    speed_rad_s: float
    powered: bool


@dataclass
class Truth:
    """A `TwinPlant` around another.

    `blocked_rad` holds the shaft fast there, `loose` lets no torque get to it, `pull` is added to
    the wrench that the sensor feels.
    """

    plant: TwinPlant
    blocked_rad: float | None = None
    loose: bool = False
    pull: np.ndarray = field(default_factory=lambda: np.zeros(6))
    moments: list[Moment] = field(default_factory=list)

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: np.ndarray) -> np.ndarray:
        wrench = self.plant.advance(to_s, self._reaching(drive), force_times_s)
        shaft = self.plant.shaft()
        self.moments.append(Moment(to_s, shaft.angle_rad, shaft.speed_rad_s, drive != ShaftDrive()))
        return wrench + self.pull

    def _reaching(self, drive: ShaftDrive) -> ShaftDrive:
        if self.loose:
            return ShaftDrive()
        if self.blocked_rad is None:
            return drive
        return _held_fast(drive, self.blocked_rad)

    def shaft(self) -> ShaftState:
        return self.plant.shaft()

    def set_height(self, height_m: float) -> None:
        self.plant.set_height(height_m)

    def block(self) -> None:
        self.blocked_rad = self.plant.shaft().angle_rad

    def after(self, at_s: float) -> list[Moment]:
        return [moment for moment in self.moments if moment.at_s > at_s]


def _held_fast(drive: ShaftDrive, angle_rad: float) -> ShaftDrive:
    """The same law with a stiff spring and damper to where the shaft stands."""
    gain = drive.angle_gain_Nm_per_rad + BLOCK_Nm_per_rad
    damping = drive.speed_gain_Nm_s_per_rad + BLOCK_Nm_s_per_rad
    return drive._replace(
        angle_gain_Nm_per_rad=gain,
        angle_rad=(drive.angle_gain_Nm_per_rad * drive.angle_rad + BLOCK_Nm_per_rad * angle_rad)
        / gain,
        speed_gain_Nm_s_per_rad=damping,
        speed_rad_s=drive.speed_gain_Nm_s_per_rad * drive.speed_rad_s / damping,
    )


@dataclass(frozen=True)
class Stop:
    """From a cause to the end of the torque, and to standstill; in ms and in degrees that the
    shaft went meanwhile. NaN: not seen.
    """

    torque_ms: float
    torque_deg: float
    stands_ms: float
    stands_deg: float


def stop_after(moments: list[Moment], cause_s: float) -> Stop:
    """What the truth says of a stop; `moments` begin before the cause, and go on for a while
    after the run.
    """
    before = [moment for moment in moments if moment.at_s <= cause_s + 1e-9]
    after = moments[len(before) :]
    began = before[-1] if before else after[0]
    powered = [at for at, moment in enumerate(after) if moment.powered]
    off = powered[-1] + 1 if powered else 0
    if off >= len(after):
        return Stop(np.nan, np.nan, np.nan, np.nan)
    gone = after[off - 1] if off else began
    stands = _stands_from(after, off)
    return Stop(
        *_way(began, gone, after[:off]),
        *((np.nan, np.nan) if stands is None else _way(began, after[stands], after[: stands + 1])),
    )


def _stands_from(after: list[Moment], first: int) -> int | None:
    since: int | None = None
    for at in range(first, len(after)):
        if abs(after[at].speed_rad_s) > STANDS_RAD_S:
            since = None
        elif since is None:
            since = at
        elif after[at].at_s - after[since].at_s >= STANDS_FOR_S:
            return since
    return None


def _way(began: Moment, ended: Moment, between: list[Moment]) -> tuple[float, float]:
    farthest_rad = max((abs(moment.angle_rad - began.angle_rad) for moment in between), default=0.0)
    return 1e3 * (ended.at_s - began.at_s), float(np.degrees(farthest_rad))
