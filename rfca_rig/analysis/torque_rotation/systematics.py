"""Systematic errors common to many stages: zeros of encoder, marks and sensor, mass, height, floor."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.stages import FORCES, StageData

Floats = NDArray[np.float64]

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
# A mark placed 0.05 mm off its hinge turns two links by this angle.
MARKS_DEG = 0.1


@dataclass(frozen=True)
class SystematicError:
    """One quantity with nominal value 0 and a prior standard deviation.

    `says`, `unit` and the factor `scale` to it are for a reader. With `is_log` it is the logarithm of a factor. With a `column` it shifts
    that column of the measured values, of one recording or of all.
    """

    name: str
    std: float
    says: str
    unit: str = ""
    scale: float = 1.0
    column: int | None = None
    recording: int = ALL_RECORDINGS
    is_log: bool = False

    def convert(self, value: float, std: float) -> tuple[float, float]:
        """Value and standard deviation in its unit."""
        # First-order propagation: the deviation of exp(v) is exp(v) times that of v.
        grown = float(np.exp(value)) if self.is_log else 1.0
        return self.scale * (grown - 1.0 if self.is_log else value), self.scale * grown * std


@dataclass(frozen=True)
class SystematicErrors:
    """All systematic errors, in the order of the unknowns; `std` is (count,)."""

    each: tuple[SystematicError, ...]

    @property
    def std(self) -> Floats:
        return np.array([systematic_error.std for systematic_error in self.each])

    def place(self, name: str) -> int | None:
        """Its index, None where it is not an unknown."""
        return next((i for i, systematic_error in enumerate(self.each) if systematic_error.name == name), None)


@dataclass(frozen=True)
class Instruments:
    """Standard errors of sensor and marks where no recording states them. A gain counts as exact unless stated."""

    gain_relative: float = 0.0
    marks_deg: float = MARKS_DEG


def list_systematic_errors(data: StageData, known_to: Mapping[str, float | None], instruments: Instruments) -> SystematicErrors:
    """The systematic errors that `known_to` states, and those that every rig has although they are not stated."""
    # Each height of the rack is set separately, so each has an error of its own.
    std_m = 1e-3 * (known_to.get("height_mm") or HEIGHT_MM)
    each = [
        *_common(data.hinges, known_to, instruments.gain_relative),
        *(SystematicError(f"height_{i}", std_m, f"height of {1e3 * height:g} mm", "mm", 1e3) for i, height in enumerate(data.heights_m)),
        *_tares(data),
        *(_mark(hinge, instruments.marks_deg) for hinge in range(data.hinges)),
        *(_rest(hinge, known_to.get("rest_angle_deg") or 0.0) for hinge in range(data.hinges)),
    ]
    # An error with deviation 0 counts as exact and needs no unknown.
    return SystematicErrors(tuple(systematic_error for systematic_error in each if systematic_error.std > 0.0))


def _common(hinges: int, known_to: Mapping[str, float | None], gain_relative: float) -> list[SystematicError]:
    return [
        SystematicError(
            "shaft_zero", np.radians(known_to.get("start_angle_deg") or 0.0), "zero of the shaft's angle", "°", np.degrees(1.0), hinges
        ),
        SystematicError("mass", known_to.get("mass_relative") or 0.0, "mass of the leg", "%", 100.0),
        SystematicError("gain", gain_relative, "gain of the force sensor", "%", 100.0),
        SystematicError("friction_lever", LEVER_M, "lever of the floor's friction", "mm", 1e3),
        SystematicError(
            "contact", known_to.get("contact_stiffness_relative") or CONTACT_RELATIVE, "stiffness of the floor", "%", 100.0, is_log=True
        ),
        SystematicError("slope", SLOPE, "slope of the floor", "mm/m", 1e3),
    ]


def _tares(data: StageData) -> list[SystematicError]:
    """A tare is known no better than one sample of the sensor. Each recording has its own."""
    return [
        SystematicError(f"tare_{name}_{i}", std, f"tare of {name.split('_')[0]}" + (f", recording {i + 1}" if several else ""), unit, 1.0,
              data.hinges + 1 + k, i)
        for several in (data.recording.max() > 0,)
        for i in np.unique(data.recording)
        for k, (name, std, unit) in enumerate(zip(FORCES, data.sample_noise, ("N", "N", "N m"), strict=True))
    ]  # fmt: skip


def _mark(hinge: int, marks_deg: float) -> SystematicError:
    return SystematicError(f"hinge_zero_{hinge + 2}", np.radians(marks_deg), f"zero of hinge {hinge + 2}", "°", np.degrees(1.0), hinge)


def _rest(hinge: int, std_deg: float) -> SystematicError:
    return SystematicError(rest_name(hinge), np.radians(std_deg), f"rest angle of hinge {hinge + 2}", "°", np.degrees(1.0))


def rest_name(hinge: int) -> str:
    """Name of the error of a hinge's rest angle; hinges count from 0 here."""
    return f"rest_{hinge + 2}"
