"""Static stages as arrays: measured values of each stage and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.model import Recording, StaticStage

Floats = NDArray[np.float64]

FORCES = ("fy_N", "fz_N", "tx_Nm")
# One sample of a six-axis sensor for some hundred newtons.
USUAL_NOISE = {"fy_N": 0.1, "fz_N": 0.15, "tx_Nm": 0.006}
# The variance of a stage's mean is at least this factor below that of one sample.
MEAN_OF_SAMPLES = 5.0
# Settled reading of an encoder.
SHAFT_STD_RAD = 2e-4
# Error of an angle that no photo shows: it has no influence.
MISSING_STD_RAD = 1.0


@dataclass(frozen=True)
class OmittedStage:
    """A stage without information on the hinges, and why."""

    recording: int
    stage: StaticStage
    why: str


@dataclass(frozen=True)
class StageData:
    """The stages that count, in their order.

    `measured` (S, h + 4) holds h hinge angles and the shaft's [rad], fy, fz [N], tx [N m]. `hinge_std_rad` (S, h) is NaN where no error was
    stated, and infinite where the angle is missing (its value is then a guess to begin from). `force_std` (S, 3) is the expected error of a
    mean. `turned` (S, h) is the direction, +1 or -1, in which the hinge reached its angle; 0 where the change is within the errors.
    """

    stages: tuple[StaticStage, ...]
    recording: NDArray[np.intp]
    height_m: Floats
    measured: Floats
    hinge_std_rad: Floats
    force_std: Floats
    sample_noise: Floats
    turned: Floats
    left_out: tuple[OmittedStage, ...]

    @property
    def hinges(self) -> int:
        return int(self.hinge_std_rad.shape[1])

    def label(self, row: int) -> str:
        """As in "stage 3 at 215 mm"."""
        return f"stage {self.stages[row].stage} at {1e3 * self.stages[row].height_m:g} mm"

    @property
    def heights_m(self) -> Floats:
        """The distinct heights, ascending."""
        return np.unique(self.height_m)

    @property
    def unstated(self) -> NDArray[np.bool_]:
        """Where an angle was measured without a stated error, (S, h)."""
        return np.isnan(self.hinge_std_rad)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where an angle was measured, (S, h)."""
        return ~np.isinf(self.hinge_std_rad)


def make_stage_data(
    recordings: Sequence[Recording], noise_std: Mapping[str, float | None], hinge_std_deg: float | None = None
) -> StageData:
    """All stages of the recordings that settled and have at least one hinge angle.

    Parameters
    ----------
    recordings
        Recordings with static stages.
    noise_std
        Noise of one sample by channel, as far as the rig's description states it.
    hinge_std_deg
        Error of a hinge angle where a stage does not state its own.
    """
    usable: list[tuple[int, StaticStage]] = []
    left_out: list[OmittedStage] = []
    for number, recording in enumerate(recordings):
        for stage in recording.static:
            why = "" if np.isfinite(stage.hinge_deg).any() else "no hinge angle"
            if stage.settled is False:
                why = "had not settled"
            if why:
                left_out.append(OmittedStage(number, stage, why))
            else:
                usable.append((number, stage))
    return _arrays(usable, left_out, noise_std, hinge_std_deg)


def _arrays(
    kept: Sequence[tuple[int, StaticStage]],
    left: Sequence[OmittedStage],
    noise_std: Mapping[str, float | None],
    hinge_std_deg: float | None,
) -> StageData:
    stages = tuple(stage for _, stage in kept)
    number = np.array([number for number, _ in kept], dtype=np.intp)
    hinge_deg = np.array([stage.hinge_deg for stage in stages])
    std_deg = np.array([stage.hinge_std_deg for stage in stages])
    if hinge_std_deg is not None:
        std_deg = np.where(np.isnan(std_deg), hinge_std_deg, std_deg)
    # NaN means that the error was not stated, infinity that the angle is missing; both cases are distinguished later.
    std_deg = np.where(np.isnan(hinge_deg), np.inf, std_deg)
    others = np.array([(stage.shaft_angle_rad, stage.fy_N, stage.fz_N, stage.tx_Nm) for stage in stages])
    # Heights within 0.01 mm are one height, with one common error.
    height_m = np.array([round(stage.height_m, 5) for stage in stages])
    sample = np.array([noise_std.get(name) or USUAL_NOISE[name] for name in FORCES])
    stated = np.array([[stage.std.get(name) or usual for name, usual in zip(FORCES, sample, strict=True)] for stage in stages])
    # Initial guess for missing angles: interpolated from the hinges that were seen.
    places, complete = np.arange(hinge_deg.shape[1]), hinge_deg.copy()
    for row in complete:
        seen = np.isfinite(row)
        row[~seen] = np.interp(places[~seen], places[seen], row[seen])
    return StageData(
        stages=stages,
        recording=number,
        height_m=height_m,
        measured=np.concatenate([np.radians(complete), others], axis=1),
        hinge_std_rad=np.radians(std_deg),
        # Only the start: the factor on this error is estimated from the stages.
        force_std=stated / np.sqrt(MEAN_OF_SAMPLES),
        sample_noise=sample,
        turned=_turn_directions(hinge_deg, stages, number),
        left_out=tuple(left),
    )


# A turn whose direction is beyond doubt.
CLEAR_DEG = 0.5


def _turn_directions(hinge_deg: Floats, stages: Sequence[StaticStage], number: NDArray[np.intp]) -> Floats:
    """Direction of the change since the stage before; the first stage of a series came from the straight leg."""
    before = np.zeros_like(hinge_deg)
    for i in range(1, len(stages)):
        earlier, stage = stages[i - 1], stages[i]
        # A new series begins at another height, or with loading after unloading.
        begins = earlier.height_m != stage.height_m or (earlier.direction == "unloading" and stage.direction == "loading")
        if not begins and number[i] == number[i - 1]:
            before[i] = hinge_deg[i - 1]
    change = np.nan_to_num(hinge_deg - before)
    return np.where(np.abs(change) > CLEAR_DEG, np.sign(change), 0.0)
