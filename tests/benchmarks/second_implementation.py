"""Every effect of the catalogue in the model and in the exam's simulators: python -m
tests.benchmarks.second_implementation [ID ...]

The exam's simulators share no code with the model. A table shows the effects of the leg, in its
forces. Those of pendulums are compared in tests/exam_cases/test_pendulums.py. The columns are:

- size 0: largest deviation from the plain model where the effect has no strength, absolute and as a
  share of the largest value;
- effect: rms change by the effect at a typical size, the middle of its plausible range;
- as in the exam: rms and largest deviation of both implementations, with the exam's step and the
  model's default tolerance;
- laws alone: the same with short steps and without what the simulators treat differently on
  purpose.

On purpose, the exam's sticking contacts and pins follow Dahl's law, and the model's yield like a
spring up to the friction limit. A leg is therefore compared on a floor without friction too. With
the model's own friction, drives and sensor are compared in `textbook_stroke`.

Forces are compared from 0.1 s on. The rms of fy and fz is over the loading, up to the valley, as a
share of the valley's force. The largest deviation is over the whole stroke, as a share of the
largest force. That of tx is a share of the largest tx, and the channel that deviates most counts.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.exam.nominal_world import (
    BELOW_SHAFT_M,
    LENGTHS_M,
    MASSES_KG,
    RAMP_S,
    START_RAD,
    nominal_world,
)
from rfca_rig.exam.sampled_rig import EFFECTS, with_effect
from rfca_rig.exam.simulator.experiment import (
    BEFORE_S,
    RELEASED_S,
    SAMPLE_S,
    STEP_S,
    SWEEP_RAD,
    sense,
    simulate,
)
from rfca_rig.exam.simulator.world import World, for_each_hinge
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.effect import Parameter
from rfca_rig.model.parameters import (
    Drive,
    Ground,
    Leg,
    PresentEffect,
    RigModel,
    SensorMount,
    Swing,
)
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.effects.rigs import TIGHT, paper_stroke
from tests.model.effects.test_strength import NEUTRAL

Floats = NDArray[np.float64]
Values = dict[str, float]

# Effects that no second simulator has, each with the reason. A new effect needs a second
# implementation or a line here.
WITHOUT_SECOND: Mapping[str, str] = {}

OF_LEGS = tuple(id_ for id_ in catalogue() if id_ in EFFECTS)

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
STROKES_BEFORE = 30
# Both simulators have passed the jump of the force at the end of the drive's ramp, whatever the
# clock of the sensor.
FROM_S = 0.1
FINE_STEP_S = 2.5e-5
# of a sample, two steps of the exam's simulator each
PIECES = 5
FINE = Tolerance(1e-7, 3e-4)
# Time for which a leg hangs before its command where both must begin at rest.
HANGING_S = 3.0
# Effects whose unloaded leg is bent: the exam releases every leg straight, the model unloaded, so
# both begin at rest.
FROM_REST = ("hinge_rest_angle", "hinge_rest_angle_of_one")
# Presliding of floor, pins and adhesion where it shall not matter.
SHORT_M = 3e-6
SHORT_RAD = 1e-5
SHORT_DEG = float(np.degrees(1e-5))

# Typical sizes other than the middle of the range.
TYPICAL: Mapping[str, Values] = {
    # From 1, for no effect, to the end of the range.
    "sensor_gain": {"factor": 1.1},
    "torque_scale": {"factor": 1.3},
    "heavier_link": {"link": 4.0, "mass_factor": 2.0},
    # At 6.5 N m the shaft does not get beyond the floor.
    "motor_torque_limit": {"limit_Nm": 6.8},
}


def choose_values(id_: str) -> Values:
    """The middle of the range of each parameter: geometric, or half of the largest where both
    signs are possible.
    """
    if id_ in TYPICAL:
        return dict(TYPICAL[id_])
    return {parameter.name: _middle(parameter) for parameter in catalogue()[id_].parameters}


def _middle(parameter: Parameter) -> float:
    if parameter.whole:
        return float(int(0.5 * (parameter.low + parameter.high)))
    if parameter.low > 0.0:
        middle = np.sqrt(parameter.low * parameter.high)
    else:
        middle = 0.5 * parameter.high
    return float(f"{middle:.3g}")


@dataclass(frozen=True)
class Deviation:
    """Deviation of two simulations in percent: rms and largest, and of the valley's force where
    there is one.
    """

    rms_pct: float
    most_pct: float
    valley_pct: float = np.nan


@dataclass(frozen=True)
class Comparison:
    """One line of the tables; see the head of this module."""

    id: str
    values: Values
    zero: float
    zero_pct: float
    effect_pct: float
    as_is: Deviation
    alone: Deviation


@dataclass(frozen=True)
class Forces:
    """Readings (m,) at the same times, and the true force of the leg down on the mount."""

    t_s: Floats
    channels: tuple[Floats, Floats, Floats]
    down_N: Floats


def make_rig(id_: str | None, values: Values) -> RigModel:
    """The model of the exam's nominal rig, released straight, with one effect."""
    if id_:
        effects = (PresentEffect(id_, tuple(values.items())),)
    else:
        effects = ()
    leg = Leg(LENGTHS_M, MASSES_KG, 0.003, 11.0, 4.2, 0.05, START_RAD)
    if id_ in FROM_REST:
        swing_before = None
    else:
        swing_before = Swing(-RELEASED_S, 1.0, 0.0)
    return RigModel(
        leg,
        Ground(1e5, 1.0, 0.45, 1e-4, 2.0),
        SensorMount(BELOW_SHAFT_M),
        Drive(RAMP_S),
        effects,
        swing_before,
    )


def make_world(id_: str | None, values: Values) -> World:
    """The exam's nominal rig with one effect."""
    world = replace(nominal_world(HEIGHT_M), strokes_before=STROKES_BEFORE)
    if id_:
        return with_effect(world, id_, values)
    return world


def without_differences(id_: str | None, rig: RigModel, world: World) -> tuple[RigModel, World]:
    """Both rigs without what the simulators treat differently: friction of the floor, or
    presliding where the effect is friction.
    """
    ground = rig.ground
    floor = world.floor
    hinges = world.hinges
    if id_ == "ground_stribeck":
        ground = replace(ground, presliding_m=SHORT_M)
        floor = replace(floor, presliding_m=SHORT_M)
    else:
        ground = replace(ground, friction_coefficient=0.0, drag_N_s_per_m=0.0)
        floor = replace(floor, mu=0.0, drag_N_s_per_m=0.0)
    shape: Values = {}
    if id_ == "hinge_coulomb_friction":
        shape = {"presliding_deg": SHORT_DEG}
        hinges = replace(hinges, pin_creep_rad=for_each_hinge(SHORT_RAD))
    if id_ == "ground_adhesion":
        shape = {"reach_mm": 1e3 * SHORT_M}
        floor = replace(floor, adhesion_hold_m=SHORT_M)
    effects = tuple(
        replace(effect, values=(*effect.values, *shape.items())) for effect in rig.effects
    )
    return replace(rig, ground=ground, effects=effects), replace(world, floor=floor, hinges=hinges)


def stroke_of_exam(world: World, step_s: float, hanging_s: float) -> Forces:
    """A stroke of the exam's simulator; the leg hangs for `hanging_s` longer than usual before
    the command.
    """
    end_s = SWEEP_RAD / SPEED_RAD_S + RAMP_S
    first = -round(BEFORE_S / SAMPLE_S)
    last = int(end_s / SAMPLE_S)
    # The exam's sensor takes forces as linear between samples: it is given more than are compared.
    t_s = np.arange(first * PIECES, last * PIECES + 1) * (SAMPLE_S / PIECES)
    knots = np.array([[0.0, RAMP_S, end_s + 1.0], [0.0, SPEED_RAD_S, SPEED_RAD_S]])
    knots[0] += hanging_s
    traces = replace(simulate(world, knots, t_s + hanging_s, step_s=step_s), t_s=t_s)
    fy, fz, tx = (channel[::PIECES] for channel in sense(world, traces))
    return Forces(t_s[::PIECES], (fy, fz, tx), -traces.force_d_N[::PIECES])


def stroke_of_model(
    rig: RigModel, t_s: Floats, tolerance: Tolerance | None
) -> tuple[Floats, Floats, Floats]:
    """fy, fz and tx (m,) of the same stroke by the model."""
    stroke = simulate_stroke_at_speed(
        rig, HEIGHT_M, SPEED_RAD_S, t_s, tolerance, strokes_before=(STROKES_BEFORE,)
    )
    return stroke.fy_N, stroke.fz_N, stroke.tx_Nm


def measure_deviation(one: Forces, other: tuple[Floats, Floats, Floats]) -> Deviation:
    """Deviation of two strokes, of the channel that deviates most."""
    valley = find_valley(one.t_s, one.down_N)
    # A shaft that stalls has no valley: the whole stroke is loading then.
    if isinstance(valley, Valley):
        until_s = valley.time_s
        valley_N = abs(valley.fz_N)
    else:
        until_s = one.t_s[-1]
        valley_N = np.abs(one.down_N).max()
    whole = one.t_s >= FROM_S
    loading = whole & (one.t_s <= until_s)
    largest_N = np.abs(one.down_N).max()
    largest_Nm = np.abs(one.channels[2]).max()
    rms = []
    most = []
    scales = ((valley_N, largest_N), (valley_N, largest_N), (largest_Nm, largest_Nm))
    for mine, theirs, (usual, largest) in zip(one.channels, other, scales, strict=True):
        off = mine - theirs
        rms.append(100.0 * float(np.sqrt(np.mean(off[loading] ** 2))) / usual)
        most.append(100.0 * float(np.abs(off[whole]).max()) / largest)
    mine, theirs = (find_valley(one.t_s, fz) for fz in (one.channels[1], other[1]))
    both = isinstance(mine, Valley) and isinstance(theirs, Valley)
    return Deviation(
        max(rms), max(most), 100.0 * abs(theirs.fz_N / mine.fz_N - 1.0) if both else np.nan
    )


@cache
def plain_stroke_at_rest() -> tuple[Floats, ...]:
    """fy, fz and tx (m,) of the paper's stroke without an effect."""
    stroke = paper_stroke(TIGHT)
    return stroke.fy_N, stroke.fz_N, stroke.tx_Nm


def compare_at_zero(id_: str) -> tuple[float, float]:
    """Largest deviation of fz or fy from the plain stroke [N] at size 0, and of the worst
    channel in percent of the largest value.
    """
    stroke = paper_stroke(TIGHT, **{id_: NEUTRAL[id_]})
    plain = plain_stroke_at_rest()
    off = [
        float(np.abs(a - b).max())
        for a, b in zip((stroke.fy_N, stroke.fz_N, stroke.tx_Nm), plain, strict=True)
    ]
    largest_N = float(np.abs(plain[1]).max())
    largest_Nm = float(np.abs(plain[2]).max())
    return max(off[:2]), 100.0 * max(max(off[:2]) / largest_N, off[2] / largest_Nm)


def compare_in_leg(id_: str) -> Comparison:
    """The line of one effect of the leg."""
    values = choose_values(id_)
    hanging_s = HANGING_S if id_ in FROM_REST else 0.0
    rig = make_rig(id_, values)
    world = make_world(id_, values)
    exam = stroke_of_exam(world, STEP_S, hanging_s)
    as_is = measure_deviation(exam, stroke_of_model(rig, exam.t_s, None))
    effect = measure_deviation(
        exam, stroke_of_exam(make_world(None, {}), STEP_S, hanging_s).channels
    )
    rig, world = without_differences(id_, rig, world)
    fine = stroke_of_exam(world, FINE_STEP_S, hanging_s)
    alone = measure_deviation(fine, stroke_of_model(rig, fine.t_s, FINE))
    return Comparison(id_, values, *compare_at_zero(id_), effect.rms_pct, as_is, alone)


def _rms_pct(x: Floats) -> float:
    return 100.0 * float(np.sqrt((x**2).mean(axis=0)).max())


def print_table(title: str, unit: str, rows: list[Comparison]) -> None:
    print(
        f"{title:<26} {'size 0':>18} {'effect':>8} {'as in the exam, %':>26} {'laws alone, %':>18}"
    )
    print(
        f"{'':<26} {unit:>9} {'%':>8} {'rms %':>8} {'valley':>8} {'rms':>8} {'most':>8} "
        f"{'rms':>9} {'most':>8}  values"
    )
    for row in rows:
        one = row.as_is
        other = row.alone
        print(
            f"{row.id:<26} {row.zero:9.1e} {row.zero_pct:8.4f} {row.effect_pct:8.2f} "
            f"{one.valley_pct:8.4f} {one.rms_pct:8.4f} "
            f"{one.most_pct:8.3f} {other.rms_pct:9.5f} {other.most_pct:8.4f}  "
            + ", ".join(f"{name} {value:g}" for name, value in row.values.items()),
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ids", nargs="*", metavar="ID", help="effects; all unless given")
    ids = parser.parse_args().ids or OF_LEGS
    print_table("forces of a leg", "N", [compare_in_leg(id_) for id_ in ids if id_ in OF_LEGS])
    for id_, reason in WITHOUT_SECOND.items():
        print(f"{id_}: not compared, {reason}")


if __name__ == "__main__":
    main()
