"""What is common to many stages and not quite as believed: zeros of encoder, marks and sensor, mass, height, floor."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.stages import FORCES, StageData

Floats = NDArray[np.float64]

ANY = -1
HEIGHT_MM = 1.0  # where nobody says how well the height of the rack is known
CONTACT_RELATIVE = 0.5  # the same of the floor's stiffness
LEVER_M = 4e-3  # where on a link's end the floor's friction acts: nobody measures it
SLOPE = 3e-3  # of the floor along the motion: levelled by eye
MARKS_DEG = 0.1  # a mark put on 0.05 mm beside its hinge turns two links by so much


@dataclass(frozen=True)
class SystematicError:
    """One quantity, 0 as believed, with a prior standard deviation.

    `says`, `unit` and the `scale` to it are for a reader; one that `is_log` is the logarithm of a factor. One with a `column` shifts that
    column of what was measured, of one recording or of any.
    """

    name: str
    std: float
    says: str
    unit: str = ""
    scale: float = 1.0
    column: int | None = None
    recording: int = ANY
    is_log: bool = False

    def shown(self, value: float, std: float) -> tuple[float, float]:
        """Value and standard deviation in its unit."""
        grown = float(np.exp(value)) if self.is_log else 1.0
        return self.scale * (grown - 1.0 if self.is_log else value), self.scale * grown * std


@dataclass(frozen=True)
class SystematicErrors:
    """All of them, in the order of the unknowns."""

    each: tuple[SystematicError, ...]

    @property
    def std(self) -> Floats:
        return np.array([systematic_error.std for systematic_error in self.each])

    def place(self, name: str) -> int | None:
        """Where it stands, None where it is not doubted."""
        return next((i for i, systematic_error in enumerate(self.each) if systematic_error.name == name), None)


@dataclass(frozen=True)
class Instruments:
    """How well sensor and marks are known where no recording says it. A gain counts as exact unless stated."""

    gain_relative: float = 0.0
    marks_deg: float = MARKS_DEG


def list_systematic_errors(data: StageData, known_to: Mapping[str, float | None], instruments: Instruments) -> SystematicErrors:
    """The systematic errors that `known_to` states, and those that nobody states but every rig has."""
    each = [
        *_common(data.hinges, known_to, instruments.gain_relative),
        *_heights(data, known_to),
        *_tares(data),
        *(_mark(hinge, instruments.marks_deg) for hinge in range(data.hinges)),
        *(_rest(hinge, known_to.get("rest_angle_deg") or 0.0) for hinge in range(data.hinges)),
    ]
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


def _heights(data: StageData, known_to: Mapping[str, float | None]) -> list[SystematicError]:
    std_m = 1e-3 * (known_to.get("height_mm") or HEIGHT_MM)
    return [SystematicError(f"height_{i}", std_m, f"height of {1e3 * height:g} mm", "mm", 1e3) for i, height in enumerate(data.heights_m)]


def _tares(data: StageData) -> list[SystematicError]:
    """A tare is known no better than one sample of the sensor."""
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
    """The systematic error of what a hinge's rest angle is off; hinges count from 0 here."""
    return f"rest_{hinge + 2}"
