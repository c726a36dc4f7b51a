"""Finds slips of unit and sign in an imported recording: every quantity is compared with others of
the same recording.

Entry point: `find_slips`. A quantity is suspicious where it lies far outside the range in which
legs of any size work. The guess is the unit whose factor brings it back. Ranges are wide, because a
wrong refusal costs more than a slip that another check finds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Recording, StaticStage, Stroke

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
RAD_PER_DEG = math.pi / 180.0
# Factor from the slip to the right unit, and the unit that was probably meant.
LENGTHS = {1e3: "metres", 10.0: "centimetres", 25.4: "inches", 1e-3: "micrometres"}
MASSES = {1e3: "kilograms", 453.6: "pounds", 1e-3: "milligrams"}
FORCES = {1e3: "kN", 1e-3: "mN", 1e-3 * GRAVITY_M_S2: "gf", GRAVITY_M_S2: "kgf"}
MOMENTS = {1e-3: "N mm or forces in kN", 1e3: "kN m or forces in mN", 0.01: "N cm"}
ANGLES = {RAD_PER_DEG: "degrees", 2.0 * math.pi: "turns", 1e-3: "mrad"}
SPEEDS = {
    RAD_PER_DEG: "deg/s",
    math.pi / 30.0: "rpm",
    2.0 * math.pi: "turns per second",
    1e-3: "mrad/s",
}
TIMES = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds", 60.0: "minutes"}
# Beside each other, either of two quantities may be the wrong one.
HEIGHTS = {
    **{
        1e3: "metres or link lengths in micrometres",
        10.0: "centimetres",
        25.4: "inches",
        1e-3: "micrometres or link lengths in metres",
    },
    **{0.1: "link lengths in centimetres", 1.0 / 25.4: "link lengths in inches"},
}
STATED_SPEEDS = {
    **SPEEDS,
    **{1.0 / factor: f"shaft angle in {unit}" for factor, unit in ANGLES.items()},
    60.0: "time in minutes",
}


@dataclass(frozen=True)
class Slip:
    """A quantity that is probably in another unit or of the other sign.

    `where` names the key or stroke, `what` the quantity, `found` says why it is suspicious, `guess`
    what was probably meant, "" for no guess.
    """

    where: str
    what: str
    found: str
    guess: str = ""

    @property
    def words(self) -> str:
        if self.guess:
            return f"{self.what}: {self.found}: {self.guess}"
        return f"{self.what}: {self.found}"


def find_slips(recording: Recording) -> list[Slip]:
    """Slips in the nominal values, then in each condition's first stroke and in the static
    stages, without repetitions.
    """
    leg = recording.nominal.get("leg", {})
    slips = [*_leg_slips(leg), *_rig_slips(recording.nominal)]
    length_m = 1e-3 * sum(leg.get("link_lengths_mm", ()))
    weight_N = 1e-3 * GRAVITY_M_S2 * sum(leg.get("link_masses_g", ()))
    # A leg that is wrong itself is no measure for the rest.
    if slips or not length_m or not weight_N:
        return slips
    seen: set[tuple[float, float]] = set()
    for number, stroke in enumerate(recording.strokes, 1):
        condition = stroke.height_m, stroke.speed_rad_s
        if condition not in seen:
            seen.add(condition)
            slips += _stroke_slips(stroke, f"stroke {number}", length_m, weight_N)
    for stage in recording.static:
        where = f"static stage {stage.stage} at {1e3 * stage.height_m:g} mm"
        slips += _compare(
            where, "height", stage.height_m, (0.15 * length_m, 1.2 * length_m), HEIGHTS
        )
        slips += _compare(
            where, "shaft angle", abs(stage.shaft_angle_rad), (0.0, 2.0 * math.pi), ANGLES
        )
        if slips:
            break
    slips += _static_force_slips(recording.static, length_m, weight_N)
    first: dict[tuple[str, str], Slip] = {}
    for slip in slips:
        first.setdefault((slip.what, slip.guess or slip.found), slip)
    return list(first.values())


def refuse_slips(folder: Path, recording: Recording) -> None:
    """Raises BadInput, one line, with the likeliest slip of the campaign in `folder` and how to
    go on.
    """
    slips = find_slips(recording)
    if slips:
        if len(slips) > 1:
            more = f" (and {len(slips) - 1} more; rfca-rig check {folder} lists them)"
        else:
            more = ""
        raise BadInput(
            f"{folder}: {slips[0].where}: {slips[0].words}{more}; correct it, or take it "
            "with --as-is"
        )


def _leg_slips(leg: Mapping[str, Any]) -> Iterator[Slip]:
    """Length and mass of any leg on a bench, its mass per length, and angles that a full turn
    contains.
    """
    lengths = leg.get("link_lengths_mm", ())
    masses = leg.get("link_masses_g", ())
    if lengths:
        yield from _compare(
            "leg.link_lengths_mm", "sum in mm", float(sum(lengths)), (20.0, 3000.0), LENGTHS
        )
    if masses:
        yield from _compare(
            "leg.link_masses_g", "sum in g", float(sum(masses)), (5.0, 50_000.0), MASSES
        )
        density = sum(masses) / max(sum(lengths), 1e-9)
        yield from _compare(
            "leg.link_masses_g", "mass per length in g/mm", density, (0.02, 50.0), MASSES
        )
    if radius_mm := leg.get("link_radius_mm"):
        yield from _compare(
            "leg.link_radius_mm", "radius in mm", float(radius_mm), (0.05, 100.0), LENGTHS
        )
    start_rad = abs(float(leg.get("start_angle_rad", 0.0)))
    yield from _compare(
        "leg.start_angle_rad", "start angle in rad", start_rad, (0.0, math.pi), ANGLES
    )


def _rig_slips(nominal: Mapping[str, Any]) -> Iterator[Slip]:
    below_mm = abs(float(nominal.get("sensor", {}).get("below_shaft_mm", 0.0)))
    if below_mm:
        yield from _compare(
            "sensor.below_shaft_mm", "distance in mm", below_mm, (0.5, 2000.0), LENGTHS
        )
    ramp_s = float(nominal.get("drive", {}).get("ramp_s", 0.0))
    yield from _compare("drive.ramp_s", "ramp in s", ramp_s, (0.0, 5.0), TIMES)


def _stroke_slips(stroke: Stroke, where: str, length_m: float, weight_N: float) -> Iterator[Slip]:
    """Slips of one stroke: height beside the leg, time, angle, speed, forces beside the weight,
    signs.
    """
    yield from _compare(
        where, "height", stroke.height_m, (0.15 * length_m, 1.2 * length_m), HEIGHTS
    )
    for stream in stroke.streams.values():
        t_s = stream.t_s
        if len(t_s) < 10:
            continue
        time_slips = list(
            _compare(
                where,
                "time between samples in s",
                float(np.median(np.diff(t_s))),
                (1e-6, 0.05),
                TIMES,
            )
        )
        yield from time_slips
        columns = {name: column.values for name, column in stream.columns.items()}
        if "shaft_angle_rad" in columns and not time_slips:
            yield from _shaft_slips(where, t_s, columns["shaft_angle_rad"], stroke.speed_rad_s)
        elif not time_slips:
            # A stroke is about one turn, so its duration bounds the speed.
            yield from _compare(
                where,
                "duration times speed in rad",
                float(t_s[-1]) * stroke.speed_rad_s,
                (0.2, 25.0),
                SPEEDS,
            )
        yield from _force_slips(where, t_s, columns, length_m, weight_N)


def _shaft_slips(where: str, t_s: Floats, angle_rad: Floats, stated_rad_s: float) -> Iterator[Slip]:
    """The travel of one stroke, at most a turn, and the speed in its middle."""
    moving = t_s > 0.0
    if moving.any():
        travel = float(np.ptp(angle_rad[moving]))
    else:
        travel = 0.0
    angle_slips = list(
        _compare(where, "travel of the shaft in rad", travel, (0.02, 2.2 * math.pi), ANGLES)
    )
    yield from angle_slips
    if angle_slips or not moving.any():
        return
    middle = moving & (t_s > 0.3 * t_s[-1]) & (t_s < 0.9 * t_s[-1])
    if np.count_nonzero(middle) > 2:
        speed = float(np.polyfit(t_s[middle], angle_rad[middle], 1)[0])
    else:
        speed = 0.0
    # The stated speed may be in another unit, or the recorded angle in one that leaves its travel
    # below a turn.
    yield from _compare(
        where,
        "stated speed beside the recorded one",
        stated_rad_s / max(abs(speed), 1e-9),
        (0.5, 2.0),
        STATED_SPEEDS,
    )
    if speed < 0.0 < stated_rad_s:
        finding = f"falls at {abs(speed):.3g} rad/s where the stated speed is positive"
        yield Slip(where, "shaft angle", finding, "is its sign turned?")


def _force_slips(
    where: str, t_s: Floats, columns: Mapping[str, Floats], length_m: float, weight_N: float
) -> Iterator[Slip]:
    """Peaks of the forces beside the leg's weight, the moment beside force times length, and the
    direction of the ground's push.
    """
    rest = t_s < 0.0
    moving = t_s > 0.0
    if not (rest.any() and moving.any()):
        return
    change = {
        name: values - np.mean(values[rest])
        for name, values in columns.items()
        if name in ("fy_N", "fz_N", "tx_Nm")
    }
    peak = {name: float(np.abs(values[moving]).max()) for name, values in change.items()}
    for name in ("fy_N", "fz_N"):
        if name in peak:
            yield from _compare(
                where,
                f"peak of {name} beside the leg's weight",
                peak[name] / weight_N,
                (0.3, 600.0),
                FORCES,
            )
    if "tx_Nm" in peak and "fz_N" in peak:
        lever = peak["tx_Nm"] / max(peak["fz_N"] * length_m, 1e-9)
        yield from _compare(
            where, "peak of tx_Nm beside fz_N times the leg's length", lever, (0.01, 30.0), MOMENTS
        )
    if "fz_N" in change:
        impulse = float(np.trapezoid(change["fz_N"][moving], t_s[moving]))
        strength = float(np.trapezoid(np.abs(change["fz_N"][moving]), t_s[moving]))
        # The ground only pushes: over a stroke the mean of fz, positive downwards, is negative.
        if impulse > 0.3 * strength:
            yield Slip(
                where,
                "fz_N",
                "the ground pulls the leg down over the whole stroke",
                "is its sign turned?",
            )


def _static_force_slips(
    stages: Sequence[StaticStage], length_m: float, weight_N: float
) -> Iterator[Slip]:
    """The largest forces of all stages beside the leg's weight, and the largest moment beside
    force times length.
    """
    if not stages:
        return
    peak = {}
    for name in ("fy_N", "fz_N", "tx_Nm"):
        peak[name] = max(abs(getattr(stage, name)) for stage in stages)
    # Stages without contact show little more than parts of the weight.
    yield from _compare(
        "static stages",
        "largest fz_N beside the leg's weight",
        peak["fz_N"] / weight_N,
        (0.02, 600.0),
        FORCES,
    )
    if peak["fz_N"] > 0.02 * weight_N:
        lever = peak["tx_Nm"] / (peak["fz_N"] * length_m)
        yield from _compare(
            "static stages",
            "largest tx_Nm beside fz_N times the leg's length",
            lever,
            (0.01, 30.0),
            MOMENTS,
        )


def _compare(
    where: str,
    what: str,
    value: float,
    plausible: tuple[float, float],
    factors: Mapping[float, str],
) -> Iterator[Slip]:
    """A slip where `value` is outside `plausible`, with the units that bring it back into the
    range, the most usual first.
    """
    low, high = plausible
    if low <= value <= high:
        return
    if not math.isfinite(value):
        yield Slip(where, what, f"is {value}")
        return
    fitting = [
        unit for factor, unit in factors.items() if value > 0.0 and low <= value * factor <= high
    ]
    guess = ""
    if fitting:
        guess = f"{' or '.join(fitting)}?"
    yield Slip(where, what, f"{value:.4g} where {low:.3g} to {high:.3g} is plausible", guess)
