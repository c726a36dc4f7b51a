"""How a force sensor is mounted, from three pushes and a known mass.

The load of each step is measured against the unloaded sensor, so neither the tare nor the leg's
weight matters. From the pushes follow the axes, from the mass the counts per newton and the lever,
from the push along y the distance below the shaft.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import Clock
from rfca_rig.codecs.sensor_axes import NAMES, SensorAxes
from rfca_rig.description.rig_file import MountedSensorSection
from rfca_rig.devices.checks import Colour, Finding, green, red, yellow
from rfca_rig.drivers.roles import ForceSensor
from rfca_rig.errors import DeviceError
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.twin_server.sensor_mount import SimulatedLoad, load_at_point

Floats = NDArray[np.float64]

AXES = "sensor's axes"
BELOW_SHAFT = "below_shaft"
MASS = "counts per newton"
LEVER = "lever"
CHECK = "sensor's mounting"

POLL_S = 0.01
TARE_S = 0.5
# A load counts once it has been there for so long, and is then measured for as long as a hand holds
# still.
SETTLE_S = 0.4
MEASURE_S = 1.0
LONGEST_STEP_S = 120.0
SILENT_S = 2.0
# Far above noise, and less than half a kilogram even where the sensor counts in pounds.
LEAST_PUSH_N = 1.0
# Below this share of it the hand has let go.
RELEASED_SHARE = 0.3
# A mass hangs still when two measurements differ by less of its weight.
STEADY_SHARE = 0.02
# The same without a load: half of the smallest push.
STILL_N = 0.5

# A hand keeps an axis to 10 or 15 degrees; halfway to the next axis are 45.
MAX_ASIDE_DEG = 30.0
# A cord hangs plumb; beyond this the sensor is not level, or the mass touches something.
MAX_TILT_DEG = 5.0
# Accuracy of a calibration 1 to 2 %, of a kitchen scale 1 %, friction of the cord 1 %.
WEIGHT_TOLERANCE = 0.05
# Half the width of a finger tip, and a push that is not quite level.
BELOW_TOLERANCE_MM = 12.0
# A cord on a ruler, and how well the sensor is centred under the shaft.
LEVER_TOLERANCE_MM = 5.0
LEVER_TOLERANCE = 0.05
# Before the name of an axis, by whether the force along it is negative.
SIGNS = {False: "", True: "-"}
# Ratios of the read to the true force, and what they are a sign of.
KNOWN_RATIOS = {
    1.0 / 4.4482216: "as if the sensor counted in lbf",
    4.4482216: "as if the rig file had counts per lbf",
    1.0 / 9.80665: "as if the sensor counted in kgf",
    9.80665: "as if the rig file had counts per kgf",
    2.0: "as of a calibration of another range",
    0.5: "as of a calibration of another range",
}
# The same to the accuracy of a hand scale.
RATIO_TOLERANCE = 0.03


@dataclass(frozen=True)
class LoadStep:
    """One load that a person puts on. `direction` is along the rig's axes; `mass_kg` and `lever_m`
    belong to a mass that hangs.
    """

    name: str
    instruction: str
    direction: tuple[float, float, float]
    mass_kg: float | None = None
    lever_m: float = 0.0


DOWN = LoadStep(
    "z", "push straight down on the shaft with half a kilogram or more, and hold", (0.0, 0.0, 1.0)
)
ALONG_Y = LoadStep(
    "y",
    "push level at the height of the shaft's axis, to the side where the leg reaches, and hold",
    (0.0, 1.0, 0.0),
)
ALONG_X = LoadStep(
    "x",
    "push along the shaft's axis, away from you as you see the leg reach to the right, and hold",
    (1.0, 0.0, 0.0),
)
PUSHES = (DOWN, ALONG_Y, ALONG_X)


def hang_mass(mass_kg: float, lever_mm: float) -> LoadStep:
    """The step with the known mass."""
    where = "straight below the shaft's axis"
    if lever_mm:
        side = "to the side where the leg reaches"
        if lever_mm < 0.0:
            side = "to the other side"
        where = f"{abs(lever_mm):g} mm from the shaft's axis, {side}, on something that cannot turn"
    return LoadStep(
        "mass",
        f"hang {mass_kg:g} kg {where}, and let it come to rest",
        (0.0, 0.0, 1.0),
        mass_kg,
        lever_mm / 1e3,
    )


class Hand(Protocol):
    """Who puts the loads on."""

    def apply(self, step: LoadStep) -> None:
        """Told to begin; the load may come any time after."""
        ...

    def release(self) -> None:
        """Told to take the load off."""
        ...


class SimulatedHand:
    """Implements `Hand` on a twin: pushes of 15 to 40 N that are as far beside the axis and beside
    the shaft as those of a person.
    """

    TILT = 0.07  # of the force, across: 4 degrees
    BESIDE_M = 0.002
    LEVER_STD_M = 0.001

    def __init__(
        self, load: SimulatedLoad, below_shaft_m: float, random: np.random.Generator
    ) -> None:
        self._load = load
        self._below_shaft_m = below_shaft_m
        self._random = random

    def apply(self, step: LoadStep) -> None:
        direction = np.array(step.direction)
        at_m = np.array([0.0, step.lever_m, -self._below_shaft_m])
        if step.mass_kg is None:
            aside = self.TILT * self._random.standard_normal(3)
            force_N = self._random.uniform(15.0, 40.0) * (direction + aside)
            at_m += self.BESIDE_M * self._random.standard_normal(3)
        else:
            force_N = step.mass_kg * GRAVITY_M_S2 * direction
            at_m[1] += self.LEVER_STD_M * self._random.standard_normal()
        self._load.wrench = load_at_point(force_N, at_m)

    def release(self) -> None:
        self._load.wrench = np.zeros(6)


class LoadMeter:
    """Measures loads against the unloaded sensor, in N and N m along the device's axes."""

    def __init__(self, sensor: ForceSensor, clock: Clock, hand: Hand) -> None:
        self._sensor = sensor
        self._clock = clock
        self._hand = hand
        scale = sensor.scale()
        self._counts_per_unit = np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)

    def measure(self, step: LoadStep) -> Floats:
        """The load (6,) of one step.

        Raises DeviceError where the sensor is silent or beyond its range, or no load comes.
        """
        unloaded = self._wait_for_rest(TARE_S, STILL_N)
        self._hand.apply(step)
        try:
            self._wait_for_load(unloaded, step)
            if step.mass_kg is None:
                load = self._mean(MEASURE_S) - unloaded
            else:
                # It swings at first.
                largest_N = STEADY_SHARE * step.mass_kg * GRAVITY_M_S2
                load = self._wait_for_rest(MEASURE_S, largest_N) - unloaded
        finally:
            self._hand.release()
        self._wait_for_release(unloaded, float(np.linalg.norm(load[:3])))
        health = self._sensor.health()
        if health.saturated or health.faulty_status:
            reason = next(iter(health.notes), "its status words are not healthy")
            raise DeviceError(f"force sensor: {reason}; push less, and see rfca-rig doctor")
        return load

    def _wait_for_load(self, unloaded: Floats, step: LoadStep) -> None:
        until_s = self._clock.now_s() + LONGEST_STEP_S
        since_s = None
        largest_N = 0.0
        while self._clock.now_s() < until_s:
            force_N = self._force_N(self._mean(5 * POLL_S) - unloaded)
            largest_N = max(largest_N, force_N)
            if force_N < LEAST_PUSH_N * self._smallest_share(step):
                since_s = None
            elif since_s is None:
                since_s = self._clock.now_s()
            elif self._clock.now_s() - since_s >= SETTLE_S:
                return
        raise DeviceError(
            f"force sensor: no load within {LONGEST_STEP_S:g} s at the step: {step.instruction}; "
            f"the largest change was {largest_N:.2f} N, a push must be {LEAST_PUSH_N:g} N"
        )

    def _smallest_share(self, step: LoadStep) -> float:
        """A mass that reads far too little is a finding, and must not be waited for."""
        if step.mass_kg is None:
            return 1.0
        return min(1.0, 0.05 * step.mass_kg * GRAVITY_M_S2 / LEAST_PUSH_N)

    def _wait_for_rest(self, seconds: float, largest_N: float) -> Floats:
        """Mean wrench (6,) of a time that differs by `largest_N` at most from the time before."""
        until_s = self._clock.now_s() + LONGEST_STEP_S
        before = self._mean(seconds)
        while True:
            mean = self._mean(seconds)
            change_N = self._force_N(mean - before)
            if change_N <= largest_N:
                return mean
            if self._clock.now_s() > until_s:
                raise DeviceError(
                    f"force sensor: its load still changes by {change_N:.2f} N after "
                    f"{LONGEST_STEP_S:g} s; let it come to rest, and take hands and cables off"
                )
            before = mean

    def _wait_for_release(self, unloaded: Floats, load_N: float) -> None:
        until_s = self._clock.now_s() + LONGEST_STEP_S
        while self._force_N(self._mean(5 * POLL_S) - unloaded) > RELEASED_SHARE * load_N:
            if self._clock.now_s() > until_s:
                raise DeviceError(
                    f"force sensor: the load was not taken off within {LONGEST_STEP_S:g} s"
                )

    def _force_N(self, wrench: Floats) -> float:
        return float(np.linalg.norm(wrench[:3]))

    def _mean(self, seconds: float) -> Floats:
        """Mean wrench (6,) of the records of that time."""
        total = np.zeros(6)
        count = 0
        until_s = self._clock.now_s() + seconds
        silent_s = until_s + SILENT_S
        # A slow sensor may have no record within a short time.
        while self._clock.now_s() < until_s or not count:
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            counts = self._sensor.read().counts
            total += counts.sum(axis=0)
            count += len(counts)
            if not count and self._clock.now_s() > silent_s:
                raise DeviceError(
                    f"force sensor: no record within {SILENT_S:g} s; rfca-rig doctor says more"
                )
        mean: Floats = total / count / self._counts_per_unit
        return mean


@dataclass(frozen=True)
class FoundAxes:
    """The axes that three pushes show; `aside_deg` says how far each push was beside the axis of
    the device that it moved most, by the rig's axis.
    """

    axes: SensorAxes
    aside_deg: Mapping[str, float]


def find_axes(pushes: Mapping[str, Floats]) -> FoundAxes:
    """The axes from the loads (6,) of the pushes along "x", "y" and "z"."""
    names: list[str] = []
    aside_deg: dict[str, float] = {}
    for name in NAMES:
        force = pushes[name][:3]
        largest = int(np.abs(force).argmax())
        sign = SIGNS[bool(force[largest] < 0.0)]
        names.append(f"{sign}{NAMES[largest]}")
        share = abs(force[largest]) / np.linalg.norm(force)
        aside_deg[name] = float(np.degrees(np.arccos(np.clip(share, 0.0, 1.0))))
    return FoundAxes(SensorAxes((names[0], names[1], names[2])), aside_deg)


def judge_axes(found: FoundAxes, stated: SensorAxes) -> Finding:
    """Finding on the axes: green as the rig file says, yellow for another mounting, red for what no
    mounting is.
    """
    axes = found.axes
    for name, aside_deg in found.aside_deg.items():
        if aside_deg > MAX_ASIDE_DEG:
            return red(
                AXES,
                f"the push along {name} is {aside_deg:.0f} degrees beside the sensor's next axis",
                (
                    "push again, straight along the axis; where the sensor is turned by such an "
                    "angle, turn it on its plate, or set the angle as the tool transformation of "
                    "the box and state it under [force_sensor]"
                ),
            )
    if not axes.is_permutation:
        return red(
            AXES,
            f"pushes along x, y and z read {', '.join(axes.names)}: two along one axis",
            "push again, each time along the axis that is asked for",
        )
    if not axes.is_right_handed:
        return red(
            AXES,
            (
                f"pushes along x, y and z read {', '.join(axes.names)}, a mirrored, left-handed "
                f"frame, which no mounting gives: {_mirrored_channel(axes, stated)}"
            ),
            (
                "check the calibration or matrix of the sensor, its cable and the driver; and that "
                "each push went to the side that was asked for"
            ),
        )
    if axes == stated:
        return green(AXES, f"as the rig file says: {axes}")
    return yellow(
        AXES,
        f"pushes give axes = {axes}, the rig file says {stated}: the sensor is {axes.describe()}",
        f"axes = {axes} under [sensor] of the rig file",
    )


def _mirrored_channel(axes: SensorAxes, stated: SensorAxes) -> str:
    """How a left-handed frame differs from the stated one, in the device's channels."""
    pairs = [
        (found, wanted)
        for found, wanted in zip(axes.names, stated.names, strict=True)
        if found != wanted
    ]
    if len(pairs) == 1 and pairs[0][0][-1] == pairs[0][1][-1]:
        return f"beside the rig file, f{pairs[0][0][-1]} has the wrong sign"
    if len(pairs) == 2 and pairs[0][0] == pairs[1][1] and pairs[0][1] == pairs[1][0]:
        first, second = sorted(f"f{found[-1]}" for found, _ in pairs)
        return f"beside the rig file, {first} and {second} are swapped"
    return "a channel has the wrong sign, or two are swapped"


def judge_below_shaft(push_along_y: Floats, stated_mm: float) -> tuple[Finding, float]:
    """Finding on the distance of the sensor below the shaft, and that distance in mm, from the push
    along y (6,) in the rig's axes: tx = below_shaft * fy.
    """
    fy_N = push_along_y[1]
    tx, ty, tz = push_along_y[3:]
    measured_mm = float(1e3 * tx / fy_N)
    said = (
        f"the push along y gives {_whole(measured_mm)} mm (tx / fy), the rig file says "
        f"{stated_mm:g}"
    )
    if abs(measured_mm - stated_mm) <= BELOW_TOLERANCE_MM:
        return green(BELOW_SHAFT, said), measured_mm
    expected = 1e-3 * stated_mm * fy_N
    fix = (
        "push again, at the height of the shaft's axis; then correct below_shaft_mm: from the axis "
        "down to the origin of the sensor, which its drawing shows"
    )
    tolerance = 1e-3 * BELOW_TOLERANCE_MM * abs(fy_N)
    if abs(tx + expected) <= tolerance:
        said += ": tx has the wrong sign"
        fix = "check the calibration, its matrix and the cable of the sensor"
    for name, moment in (("ty", ty), ("tz", tz)):
        if abs(abs(moment) - abs(expected)) <= tolerance and abs(tx) <= tolerance:
            said += f": tx and {name} are swapped"
            fix = "check the calibration, its matrix and the cable of the sensor"
    return red(BELOW_SHAFT, said, fix), measured_mm


def judge_mass(load: Floats, step: LoadStep) -> Finding:
    """Finding on counts per newton, from the load (6,) of the mass in the rig's axes."""
    weight_N = (step.mass_kg or 0.0) * GRAVITY_M_S2
    fz_N = float(load[2])
    ratio = fz_N / weight_N
    said = (
        f"{step.mass_kg:g} kg reads fz = {fz_N:.2f} N for {weight_N:.2f} N, "
        f"{100.0 * (ratio - 1.0):+.1f} %"
    )
    if abs(ratio - 1.0) > WEIGHT_TOLERANCE:
        likely = [
            words
            for known, words in KNOWN_RATIOS.items()
            if abs(ratio / known - 1.0) < RATIO_TOLERANCE
        ]
        said += "".join(f": {words}" for words in likely)
        return red(
            MASS,
            f"{said}, where {100.0 * WEIGHT_TOLERANCE:g} % may differ",
            (
                "compare counts_per_N and its unit with the calibration certificate and the "
                "calibration that the box has selected; weigh the mass; nothing may touch it"
            ),
        )
    tilt_deg = float(np.degrees(np.arctan2(np.hypot(load[0], load[1]), abs(fz_N))))
    if tilt_deg > MAX_TILT_DEG:
        return yellow(
            MASS,
            f"{said}, but it pulls {tilt_deg:.0f} degrees beside z",
            "level the sensor's plate; nothing may touch the mass or its cord",
        )
    return green(MASS, said)


def judge_lever(load: Floats, step: LoadStep) -> Finding:
    """Finding on the lever of the mass, from its load (6,) in the rig's axes: tx = lever * fz."""
    tx_Nm = float(load[3])
    measured_mm = 1e3 * tx_Nm / float(load[2])
    stated_mm = 1e3 * step.lever_m
    said = (
        f"the mass turns by {tx_Nm:+.3f} N m, a lever of {_whole(measured_mm)} mm for {stated_mm:g}"
    )
    allowed_mm = LEVER_TOLERANCE_MM + LEVER_TOLERANCE * abs(stated_mm)
    if abs(measured_mm - stated_mm) <= allowed_mm:
        return green(LEVER, said)
    if stated_mm and abs(measured_mm + stated_mm) <= allowed_mm:
        said += ": tx has the wrong sign, or the mass hangs on the other side"
    return red(
        LEVER,
        f"{said}, where {allowed_mm:.0f} mm may differ",
        (
            "measure the lever along y from the shaft's axis; compare counts_per_Nm and its unit "
            "with the calibration certificate; is the sensor's origin straight below the shaft?"
        ),
    )


def _whole(value: float) -> int:
    """Rounded, without the sign of a zero."""
    return round(value)


@dataclass(frozen=True)
class MountingCheck:
    """What pushes and mass showed. `axes` and the other values are None where an earlier finding is
    red.
    """

    findings: tuple[Finding, ...]
    axes: SensorAxes | None = None
    below_shaft_mm: float | None = None
    mass_N: float | None = None


def judge_mounting(
    loads: Mapping[str, Floats], mass: LoadStep, stated: SensorAxes, below_shaft_mm: float
) -> MountingCheck:
    """All findings, from the loads (6,) of the steps in the device's axes, by their names."""
    found = find_axes(loads)
    axes_finding = judge_axes(found, stated)
    # In a frame that is not known no other value means anything.
    if axes_finding.colour is Colour.RED:
        return MountingCheck((axes_finding,))
    along_y, hung = (
        found.axes.to_rig(loads[name][None, :])[0] for name in (ALONG_Y.name, mass.name)
    )
    mass_finding = judge_mass(hung, mass)
    # The other two divide by a force, which must be right first.
    if mass_finding.colour is Colour.RED:
        return MountingCheck((axes_finding, mass_finding), found.axes)
    below_finding, measured_mm = judge_below_shaft(along_y, below_shaft_mm)
    findings = (axes_finding, mass_finding, judge_lever(hung, mass), below_finding)
    return MountingCheck(findings, found.axes, measured_mm, float(hung[2]))


def judge_last_check(sensor: MountedSensorSection) -> Finding:
    """Finding on the check that the rig file of a real rig states: is there one, and of this
    mounting.
    """
    checked = sensor.checked
    fix = "three pushes of a hand and a known mass find axes, signs, counts and levers:"
    command = "rfca-rig setup sensor --rig FILE"
    if checked is None:
        return yellow(CHECK, "axes and counts were never checked with a hand", fix, command)
    if checked.source != "REAL":
        return yellow(CHECK, f"rehearsed on the twin only ({checked.date})", fix, command)
    if checked.axes != sensor.axes:
        return yellow(
            CHECK,
            f"checked on {checked.date} with axes = {SensorAxes(checked.axes)}, the rig file now "
            f"says {sensor.mounting}",
            fix,
            command,
        )
    if abs(checked.below_shaft_mm - sensor.below_shaft_mm) > BELOW_TOLERANCE_MM:
        return yellow(
            CHECK,
            f"checked on {checked.date} {checked.below_shaft_mm:.0f} mm below the shaft, the rig "
            f"file now says {sensor.below_shaft_mm:g}",
            fix,
            command,
        )
    return green(CHECK, f"checked on {checked.describe()}; axes {sensor.mounting}")


def measure_loads(
    sensor: ForceSensor, clock: Clock, hand: Hand, steps: Sequence[LoadStep]
) -> dict[str, Floats]:
    """The loads (6,) of the steps in the device's axes, by their names. The stream ends with them.

    Raises RigError where the sensor does not stream, or a load does not come.
    """
    sensor.start()
    try:
        meter = LoadMeter(sensor, clock, hand)
        return {step.name: meter.measure(step) for step in steps}
    finally:
        sensor.stop()
