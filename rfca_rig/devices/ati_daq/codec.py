"""The calibration file (.cal, XML) of an ATI DAQ F/T transducer: six gage voltages to a wrench;
pure.

Sources for elements and attributes: the comment at the head of every such file, and ATI's DAQ F/T C
library, which also gives the formula of the temperature compensation. `UserAxis` is the matrix for
user software, `Axis` a scaled one for ATI's software.
"""

from dataclasses import dataclass
from math import isfinite
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import newton_metres_per, newtons_per
from rfca_rig.errors import BadInput, MalformedFrame

Floats = NDArray[np.float64]

GAGES = 6
AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
# Largest condition number of the matrix in N and N m per volt; that of a real one is below 100.
MAX_CONDITION = 1e7


@dataclass(frozen=True, eq=False)
class TemperatureCompensation:
    """Temperature compensation of the gage voltages, by `bias_slopes` (6,) and `gain_slopes` (6,).

    compensated = (volts + bias_slope * warmth) / (1 - gain_slope * warmth), with warmth =
    thermistor - reference, all in volts.
    """

    bias_slopes: Floats
    gain_slopes: Floats
    reference_V: float

    def compensate(self, volts: Floats, thermistor_V: Floats) -> Floats:
        """Voltages (m, 6) at the reference temperature, from `volts` (m, 6) and `thermistor_V`
        (m,).
        """
        warmth = (thermistor_V - self.reference_V)[:, None]
        corrected: Floats = (volts + self.bias_slopes * warmth) / (1.0 - self.gain_slopes * warmth)
        return corrected


@dataclass(frozen=True, eq=False)
class TransducerCalibration:
    """Calibration of one transducer in SI units.

    - `matrix` (6, 6): N and N m per volt.
    - `limits` (6,): rated load in N and N m.
    - `rails_V`: lowest and highest voltage.
    - `force_unit`, `torque_unit`: those of the file.
    - `compensated_in_hardware`: a circuit in the transducer compensates for temperature.
    """

    serial_number: str
    body_style: str
    part_number: str
    date: str
    force_unit: str
    torque_unit: str
    matrix: Floats
    limits: Floats
    rails_V: tuple[float, float]
    compensated_in_hardware: bool
    temperature: TemperatureCompensation | None

    @property
    def channels(self) -> int:
        """Number of voltages in a sample: the gages, and the thermistor where the file
        compensates by it.
        """
        return GAGES + (self.temperature is not None)

    def wrench(self, volts: Floats, unloaded_V: Floats) -> Floats:
        """Wrench (m, 6) in N and N m from `volts` (m, channels).

        `unloaded_V` (channels,) are the voltages without load.
        """
        # Both are compensated before the difference: the thermistor may have changed since the
        # unloaded reading.
        if self.temperature is None:
            loaded = volts - unloaded_V
        else:
            loaded = self._at_reference(volts) - self._at_reference(unloaded_V[None, :])
        forces: Floats = loaded @ self.matrix.T
        return forces

    def _at_reference(self, volts: Floats) -> Floats:
        assert self.temperature is not None
        return self.temperature.compensate(volts[:, :GAGES], volts[:, GAGES])

    def volts(self, wrench: Floats, unloaded_V: Floats) -> Floats:
        """Gage voltages (m, 6) of a `wrench` (m, 6), its inverse at the reference temperature;
        `unloaded_V` is (channels,).
        """
        gages: Floats = np.linalg.solve(self.matrix, wrench.T).T + unloaded_V[:GAGES]
        return gages


def parse_calibration(content: bytes, where: str) -> TransducerCalibration:
    """Parse a .cal file. Raises BadInput, as one line that begins with `where`, for content that
    is incomplete or ambiguous.
    """
    try:
        return _sensor(_root(content))
    except MalformedFrame as error:
        raise BadInput(f"{where}: {error}") from None


def _root(content: bytes) -> Xml.Element:
    # A document type could define entities that expand without limit.
    if b"<!DOCTYPE" in content:
        raise MalformedFrame("declares a document type, which no calibration file does")
    try:
        root = Xml.fromstring(content)
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise MalformedFrame(
            f"not XML: {error}; take ATI's calibration file as it is on their disk"
        ) from None
    if root.tag != "FTSensor":
        raise MalformedFrame(
            f"begins with <{root.tag[:40]}>, a calibration file of a DAQ F/T begins with <FTSensor>"
        )
    return root


def _sensor(root: Xml.Element) -> TransducerCalibration:
    gages = _text(root, "NumGages")
    if gages != str(GAGES):
        raise MalformedFrame(f"NumGages is {gages!r}, only transducers of {GAGES} gages are known")
    calibrations = root.findall("Calibration")
    if len(calibrations) != 1:
        raise MalformedFrame(
            f"holds {len(calibrations)} <Calibration> elements, expected one; keep the "
            "one of the range in use"
        )
    element = calibrations[0]
    to_si = np.repeat(
        [
            newtons_per(_text(element, "ForceUnits")),
            newton_metres_per(_text(element, "TorqueUnits")),
        ],
        3,
    )
    rows, limits = _axes(element)
    span_V = _positive(element, "OutputRange")
    matrix = rows * to_si[:, None]
    # Written with `not`, so that a condition number of NaN is refused too.
    if not np.linalg.cond(matrix) < MAX_CONDITION:
        raise MalformedFrame(
            "its matrix cannot be inverted, so no six gages of a transducer gave it; was "
            "a row copied?"
        )
    rails_V = (0.0, span_V)
    if _truth(element, "OutputBipolar"):
        rails_V = (-0.5 * span_V, 0.5 * span_V)
    return TransducerCalibration(
        serial_number=_text(root, "Serial"),
        body_style=root.get("BodyStyle", ""),
        part_number=_text(element, "PartNumber"),
        date=_text(element, "CalDate"),
        force_unit=_text(element, "ForceUnits"),
        torque_unit=_text(element, "TorqueUnits"),
        matrix=matrix,
        limits=limits * to_si,
        rails_V=rails_V,
        compensated_in_hardware=_truth(element, "HWTempComp", "False"),
        temperature=_temperature(element),
    )


def _axes(element: Xml.Element) -> tuple[Floats, Floats]:
    """The rows of the matrix (6, 6) and the rated loads (6,), in the order of AXES and the
    file's units.
    """
    axes = element.findall("UserAxis")
    if not axes and element.find("Axis") is not None:
        raise MalformedFrame(
            "has no <UserAxis> elements, only ATI's internal <Axis> matrix; ask ATI for "
            "a file of version 1.1"
        )
    by_name = {axis.get("Name", ""): axis for axis in axes}
    if sorted(by_name) != sorted(AXES) or len(axes) != len(AXES):
        named = ", ".join(axis.get("Name", "?")[:20] for axis in axes) or "none"
        raise MalformedFrame(
            f"names the axes {named} in <UserAxis>, expected each of {', '.join(AXES)} once"
        )
    rows = np.array([_numbers(by_name[name], "values", GAGES) for name in AXES])
    limits = np.array([_positive(by_name[name], "max") for name in AXES])
    return rows, limits


def _temperature(element: Xml.Element) -> TemperatureCompensation | None:
    """The temperature compensation. None where the file has none of its three elements; where it
    has some, it must have all.
    """
    parts = {name: element.find(name) for name in ("BiasSlope", "GainSlope", "Thermistor")}
    bias, gain, thermistor = parts.values()
    if bias is None and gain is None and thermistor is None:
        return None
    if bias is None or gain is None or thermistor is None:
        missing = ", ".join(f"<{name}>" for name, part in parts.items() if part is None)
        raise MalformedFrame(f"compensates for temperature but lacks {missing}")
    slopes = [np.array(_numbers(part, "values", GAGES)) for part in (bias, gain)]
    return TemperatureCompensation(slopes[0], slopes[1], _numbers(thermistor, "value", 1)[0])


def _text(element: Xml.Element, name: str) -> str:
    value = element.get(name, "").strip()
    if not value:
        raise MalformedFrame(f"<{element.tag}> lacks {name}")
    return value


def _truth(element: Xml.Element, name: str, default: str | None = None) -> bool:
    if default:
        value = element.get(name, default)
    else:
        value = _text(element, name)
    if value not in {"True", "False"}:
        raise MalformedFrame(f"{name} is {value!r}, must be True or False")
    return value == "True"


def _positive(element: Xml.Element, name: str) -> float:
    value = _numbers(element, name, 1)[0]
    if value <= 0.0:
        raise MalformedFrame(f"{name} is {value:g}, must be above 0")
    return value


def _numbers(element: Xml.Element, name: str, count: int) -> list[float]:
    """Numbers separated by blanks: exactly `count`, all finite."""
    words = _text(element, name).split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise MalformedFrame(
            f"{name} of <{element.tag}> holds {' '.join(words)[:60]!r}, expected numbers"
        ) from None
    if len(values) != count or not all(map(isfinite, values)):
        raise MalformedFrame(
            f"{name} of <{element.tag}> holds {' '.join(words)[:60]!r}, expected {count} "
            "finite numbers"
        )
    return values


@dataclass(frozen=True, eq=False)
class GageBlock:
    """Consecutive samples: the number of the first since the start, from 0, and `volts` (m,
    channels).
    """

    first: int
    volts: NDArray[np.float64]
