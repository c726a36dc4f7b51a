"""Static stages as arrays: measured values of each stage, their errors, and systematic errors
common to many stages.
"""

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

    `measured` (S, h + 4) holds h hinge angles and the shaft's [rad], fy, fz [N], tx [N m].
    `hinge_std_rad` (S, h) is without the gluing of the marks where a stage states that apart. It is
    NaN where no error was stated, and infinite where the angle is missing (its value is then a
    guess to begin from). `force_std` (S, 3) is the expected error of a mean.
    `turned` (S, h) is the direction, +1 or -1, in which the hinge reached its angle; 0 where the
    change is within the errors.
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
    recordings: Sequence[Recording],
    noise_std: Mapping[str, float | None],
    hinge_std_deg: float | None = None,
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
            if np.isfinite(stage.hinge_deg).any():
                why = ""
            else:
                why = "no hinge angle"
            if stage.settled is False:
                why = "had not settled"
            if why:
                left_out.append(OmittedStage(number, stage, why))
            else:
                usable.append((number, stage))
    return _arrays(usable, left_out, noise_std, hinge_std_deg)


def _stated_std(stage: StaticStage, usual_std: Floats) -> list[float]:
    """Standard deviation of each force: the stage's own, or else the usual one."""
    return [stage.std.get(name) or usual for name, usual in zip(FORCES, usual_std, strict=True)]


def _arrays(
    kept: Sequence[tuple[int, StaticStage]],
    left: Sequence[OmittedStage],
    noise_std: Mapping[str, float | None],
    hinge_std_deg: float | None,
) -> StageData:
    stages = tuple(stage for _, stage in kept)
    number = np.array([number for number, _ in kept], dtype=np.intp)
    hinge_deg = np.array([stage.hinge_deg for stage in stages])
    # How the marks are glued is the same in all stages and a systematic error of its own.
    reading_std_deg = np.array([stage.hinge_reading_std_deg for stage in stages])
    whole_std_deg = np.array([stage.hinge_std_deg for stage in stages])
    std_deg = np.where(np.isnan(reading_std_deg), whole_std_deg, reading_std_deg)
    if hinge_std_deg is not None:
        std_deg = np.where(np.isnan(std_deg), hinge_std_deg, std_deg)
    # NaN means that the error was not stated, infinity that the angle is missing; both cases are
    # distinguished later.
    std_deg = np.where(np.isnan(hinge_deg), np.inf, std_deg)
    others = np.array(
        [(stage.shaft_angle_rad, stage.fy_N, stage.fz_N, stage.tx_Nm) for stage in stages]
    )
    # Heights within 0.01 mm are one height, with one common error.
    height_m = np.array([round(stage.height_m, 5) for stage in stages])
    sample = np.array([noise_std.get(name) or USUAL_NOISE[name] for name in FORCES])
    stated = np.array([_stated_std(stage, sample) for stage in stages])
    # Initial guess for missing angles: interpolated from the hinges that were seen.
    places = np.arange(hinge_deg.shape[1])
    complete = hinge_deg.copy()
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


def _turn_directions(
    hinge_deg: Floats, stages: Sequence[StaticStage], number: NDArray[np.intp]
) -> Floats:
    """Direction of the change since the stage before; the first stage of a series came from the
    straight leg.
    """
    before = np.zeros_like(hinge_deg)
    for i in range(1, len(stages)):
        earlier = stages[i - 1]
        stage = stages[i]
        # A new series begins at another height, or with loading after unloading.
        begins = earlier.height_m != stage.height_m or (
            earlier.direction == "unloading" and stage.direction == "loading"
        )
        if not begins and number[i] == number[i - 1]:
            before[i] = hinge_deg[i - 1]
    change = np.nan_to_num(hinge_deg - before)
    return np.where(np.abs(change) > CLEAR_DEG, np.sign(change), 0.0)


# Marks an error that all recordings share.
ALL_RECORDINGS = -1
# Uncertainty of the rack's height where none is stated.
HEIGHT_MM = 1.0
# The same for the floor's stiffness.
CONTACT_RELATIVE = 0.5
# The point on a link's end where the floor's friction acts has not been measured.
LEVER_M = 4e-3
# Slope of the floor along the motion, levelled by eye.
SLOPE = 3e-3
# Marks glued to 0.1 mm (standard deviation, in each direction): a hinge angle is the second
# difference of three marks, sqrt(6) 0.1 mm over the 39.3 mm from mark to mark.
MARKS_DEG = 0.36
# Error of the scale of a hinge angle, as a share of the error of its zero in rad. A mark that is
# off along its link by a adds a / L of the angle, and so does the mark before: sqrt(2) a / L, where
# the zero errs by sqrt(6) a / L.
SCALE_SHARE = float(np.sqrt(2.0 / 6.0))


MEASURE_AGAIN = "Measure it again."
# A mark is off far more often than a hinge.
LOOK_AT_MARKS = "Look first whether its mark and the marks beside it sit on their axes."


@dataclass(frozen=True)
class SystematicError:
    """One quantity with nominal value 0 and a prior standard deviation.

    `words`, `unit` and the factor `scale` to it are for a reader. With `is_log` it is the logarithm
    of a factor. With a `column` it shifts that column of the measured values, of one recording or
    of all. `remedy` says what to do where the stages require an implausible value.
    """

    name: str
    std: float
    words: str
    unit: str = ""
    scale: float = 1.0
    column: int | None = None
    recording: int = ALL_RECORDINGS
    is_log: bool = False
    remedy: str = MEASURE_AGAIN

    def convert(self, value: float, std: float) -> tuple[float, float]:
        """Value and standard deviation in its unit."""
        if not self.is_log:
            return self.scale * value, self.scale * std
        # First-order propagation: the deviation of exp(v) is exp(v) times that of v.
        grown = float(np.exp(value))
        return self.scale * (grown - 1.0), self.scale * grown * std


@dataclass(frozen=True)
class SystematicErrors:
    """All systematic errors, in the order of the unknowns; `std` is (count,)."""

    errors: tuple[SystematicError, ...]

    @property
    def std(self) -> Floats:
        return np.array([systematic_error.std for systematic_error in self.errors])

    def place(self, name: str) -> int | None:
        """Its index, None where it is not an unknown."""
        return next(
            (i for i, systematic_error in enumerate(self.errors) if systematic_error.name == name),
            None,
        )


@dataclass(frozen=True)
class Instruments:
    """Standard errors of sensor and marks where no recording states them. A gain counts as exact
    unless stated.
    """

    gain_relative: float = 0.0
    marks_deg: float = MARKS_DEG


def list_systematic_errors(
    data: StageData, known_to: Mapping[str, float | None], instruments: Instruments
) -> SystematicErrors:
    """The systematic errors that `known_to` states, and those that every rig has although they
    are not stated.
    """
    # Each height of the rack is set separately, so each has an error of its own.
    std_m = 1e-3 * (known_to.get("height_mm") or HEIGHT_MM)
    systematic_errors = [
        *_common(data.hinges, known_to, instruments.gain_relative),
        *(
            SystematicError(f"height_{i}", std_m, f"height of {1e3 * height:g} mm", "mm", 1e3)
            for i, height in enumerate(data.heights_m)
        ),
        *_tares(data),
        *(_zero(hinge, instruments.marks_deg) for hinge in range(data.hinges)),
        *(_scale(hinge, instruments.marks_deg) for hinge in range(data.hinges)),
        *(_rest(hinge, known_to.get("rest_angle_deg") or 0.0) for hinge in range(data.hinges)),
    ]
    # An error with deviation 0 counts as exact and needs no unknown.
    return SystematicErrors(
        tuple(
            systematic_error for systematic_error in systematic_errors if systematic_error.std > 0.0
        )
    )


def _common(
    hinges: int, known_to: Mapping[str, float | None], gain_relative: float
) -> list[SystematicError]:
    return [
        SystematicError(
            "shaft_zero",
            np.radians(known_to.get("start_angle_deg") or 0.0),
            "zero of the shaft's angle",
            "°",
            np.degrees(1.0),
            hinges,
        ),
        SystematicError(
            "mass", known_to.get("mass_relative") or 0.0, "mass of the leg", "%", 100.0
        ),
        SystematicError("gain", gain_relative, "gain of the force sensor", "%", 100.0),
        SystematicError("friction_lever", LEVER_M, "lever of the floor's friction", "mm", 1e3),
        SystematicError(
            "contact",
            known_to.get("contact_stiffness_relative") or CONTACT_RELATIVE,
            "stiffness of the floor",
            "%",
            100.0,
            is_log=True,
        ),
        SystematicError("slope", SLOPE, "slope of the floor", "mm/m", 1e3),
    ]


def _tares(data: StageData) -> list[SystematicError]:
    """A tare is known no better than one sample of the sensor. Each recording has its own."""
    units = ("N", "N", "N m")
    several = data.recording.max() > 0
    tares = []
    for i in np.unique(data.recording):
        of_recording = ""
        if several:
            of_recording = f", recording {i + 1}"
        for k, (name, std, unit) in enumerate(zip(FORCES, data.sample_noise, units, strict=True)):
            words = f"tare of {name.split('_')[0]}{of_recording}"
            column = data.hinges + 1 + k
            tares.append(SystematicError(f"tare_{name}_{i}", std, words, unit, 1.0, column, i))
    return tares


def _zero(hinge: int, marks_deg: float) -> SystematicError:
    """A mark that is off across its link."""
    return SystematicError(
        f"hinge_zero_{hinge + 2}",
        np.radians(marks_deg),
        f"zero of hinge {hinge + 2}",
        "°",
        np.degrees(1.0),
        hinge,
        remedy=LOOK_AT_MARKS,
    )


def _scale(hinge: int, marks_deg: float) -> SystematicError:
    """A mark that is off along its link."""
    return SystematicError(
        scale_name(hinge),
        SCALE_SHARE * float(np.radians(marks_deg)),
        f"scale of the angle of hinge {hinge + 2}",
        "%",
        100.0,
        remedy=LOOK_AT_MARKS,
    )


def _rest(hinge: int, std_deg: float) -> SystematicError:
    return SystematicError(
        rest_name(hinge),
        np.radians(std_deg),
        f"rest angle of hinge {hinge + 2}",
        "°",
        np.degrees(1.0),
    )


def rest_name(hinge: int) -> str:
    """Name of the error of a hinge's rest angle; hinges count from 0 here."""
    return f"rest_{hinge + 2}"


def scale_name(hinge: int) -> str:
    """Name of the error of the scale of a hinge's angle; hinges count from 0 here."""
    return f"hinge_scale_{hinge + 2}"
