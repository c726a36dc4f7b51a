"""Makes effects of a law that may act in each joint, actuator or sensor: one in all of them, each
with its own size, and one in one.

A law without a formula is the torque of one joint as a table over its speed or its position. It is
linear between its knots and constant beyond them. A positive value resists a positive speed, or a
positive position.

Effects of sensors act on their readings.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Change, JointLaw, Plant
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.catalogue import catalogue, lab_texts
from rfca_rig.model.declarations import sensor as declared
from rfca_rig.model.effect import Declaration, Effect, JointTorque, Parameter, Values
from rfca_rig.model.parameters import LawTable
from rfca_rig.model.tabulated_law import TABULATED_LAW

Floats = NDArray[np.float64]

# Shares of the usual magnitude on the rig. A smaller effect is lost in the usual model error of 1
# %; with a larger one the joint would hardly move. With a tenth and ten times these bounds the log
# evidence of friction of a pendulum changes by less than 1.
SMALLEST = 0.002
LARGEST = 0.8

QUANTITIES = ("speed", "position")

# Share of a value's rms that another one may add to it: more than in any sensor that was calibrated
# at all.
MAX_CROSSTALK_SHARE = 0.5
DRIFTS_BY = 0.3  # of a sensor's rms, per second: a larger drift is visible without a model


@dataclass(frozen=True)
class PlaceLaw:
    """A declared law with one size per joint (or actuator): `low` and `high` (k,) are its plausible
    range, `change` puts it into a plant.

    `groups` are names and places, within `places`, of those that share a size; each has its own
    where there are none. `starts` are values from which the search begins, an even number in
    ascending order.
    """

    declaration: Declaration
    quantity: str
    units: tuple[str, ...]
    objects: tuple[str, ...]
    places: tuple[int, ...]
    low: Floats
    high: Floats
    change: Change
    groups: tuple[tuple[str, tuple[int, ...]], ...] = ()
    starts: tuple[float, ...] = ()


def joint_units(mechanism: Mechanism, of_hinge: str, of_slide: str) -> tuple[str, ...]:
    """Unit at the end of the parameter's name, for each joint."""
    return tuple(of_slide if slides else of_hinge for slides in mechanism.is_slide)


def join_name(*parts: str) -> str:
    """Name of a parameter from the parts that are not empty."""
    return "_".join(part for part in parts if part)


def group_places(
    mechanism: Mechanism, names: tuple[str, ...]
) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Indices of objects of the same type by the name of their group, and of each other one by
    its own name.
    """
    groups = {}
    for name, of_make in mechanism.alike.items():
        members = tuple(names.index(member) for member in of_make if member in names)
        if members:
            groups[name] = members
    grouped = {member for members in groups.values() for member in members}
    single = {name: (index,) for index, name in enumerate(names) if index not in grouped}
    return tuple({**single, **groups}.items())


def expand_law(law: PlaceLaw) -> Iterator[Effect]:
    """The effect of the law in all its joints; with several joints, the effect in one of them,
    too.
    """
    places = law.places
    many = len(law.places) > 1
    groups = law.groups or tuple((name, (index,)) for index, name in enumerate(law.objects))
    names = [
        join_name(name if len(groups) > 1 else "", law.quantity, law.units[members[0]])
        for name, members in groups
    ]

    def in_all(plant: Plant, values: Values) -> Plant:
        for (_, members), name in zip(groups, names, strict=True):
            for member in members:
                law.change(plant, places[member], values[name])
        return plant

    ranges = [
        (float(law.low[list(members)].min()), float(law.high[list(members)].max()))
        for _, members in groups
    ]
    # A grid has all combinations of the starts, so that several sizes begin from the two in the
    # middle only.
    middle = len(law.starts) // 2
    if len(groups) == 1:
        starts = law.starts
    else:
        starts = law.starts[middle - 1 : middle + 1]
    parameters = tuple(
        Parameter(name, low, high, may_be_zero=False, starts=starts)
        for name, (low, high) in zip(names, ranges, strict=True)
    )
    yield law.declaration.make_effect(parameters, in_all)
    if many:
        noun = law.declaration.single
        declaration = law.declaration.of_one()
        size = join_name(law.quantity, law.units[0] if len(set(law.units)) == 1 else "SI")

        def in_one(plant: Plant, values: Values) -> Plant:
            law.change(plant, places[int(values[noun]) - 1], values[size])
            return plant

        counted = Parameter(noun, 1.0, float(len(places)), may_be_zero=False, whole=True)
        sized = Parameter(
            size, float(law.low.min()), float(law.high.max()), may_be_zero=False, starts=law.starts
        )
        # The numbers are not those of the model, so the text lists them.
        if places != tuple(range(len(places))):
            numbers = (f"{number} is {name}" for number, name in enumerate(law.objects, start=1))
            words = f"{declaration.left_out} ({', '.join(numbers)})"
            declaration = replace(declaration, left_out=words)
        yield declaration.make_effect((counted, sized), in_one)


def name_argument(mechanism: Mechanism, joint: int, quantity: str) -> str:
    """Name of the argument of a table of this joint over its "speed" or "position", with the
    unit.
    """
    unit = "m" if mechanism.is_slide[joint] else "rad"
    if quantity == "speed":
        return f"{quantity}_{unit}_s"
    return f"{quantity}_{unit}"


def make_tabulated_effect(mechanism: Mechanism, table: LawTable) -> Effect:
    """The effect that puts a table into a plant; its place is a joint's name, its argument as of
    `name_argument`.
    """
    joint = mechanism.joints.index(table.place)
    count = len(table.knots)
    knots = np.array(table.knots)
    values = np.array(table.values)
    law = JointLaw(joint, table.argument.startswith("speed"), knots, values, np.zeros(count))

    def apply(plant: Plant, values: Values) -> Plant:  # noqa: ARG001
        plant.laws = (*plant.laws, law)
        return plant

    return Effect(
        TABULATED_LAW,
        "joints",
        f"a law of {table.argument} in {table.place}",
        "tabulated",
        "measured",
        (),
        apply,
    )


# Of the table of a lab's own law: the speed is followed up to this many times the usual one, the
# position up to this share of its range beyond it. Knots are denser around zero.
MOST_SPEEDS = 10.0
BEYOND_RANGE = 1.0
KNOTS = 61
NEAR_ZERO = 0.05


def list_own_effects(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Lists the effects of a lab's own that state a torque in the joints of a mechanism."""
    for effect_id in lab_texts(catalogue()):
        effect = catalogue()[effect_id]
        if effect.joint_torque is not None:
            yield replace(
                effect,
                where="joints",
                apply=partial(_tabulate, mechanism, usual, effect.joint_torque),
            )


def _tabulate(
    mechanism: Mechanism, usual: UsualMotion, law: JointTorque, plant: Plant, values: Values
) -> Plant:
    """The plant with a table of the law in each joint that moves."""
    tables = []
    for joint in mechanism.simulated:
        if law.quantity == "speed":
            scale = NEAR_ZERO * MOST_SPEEDS * usual.speed[joint]
            edge = np.arcsinh(1.0 / NEAR_ZERO)
            knots = scale * np.sinh(np.linspace(-edge, edge, KNOTS))
        else:
            beyond = BEYOND_RANGE * usual.half_range[joint]
            knots = np.linspace(usual.lowest[joint] - beyond, usual.highest[joint] + beyond, KNOTS)
        torque = np.asarray(law.torque(knots, values), dtype=np.float64)
        tables.append(JointLaw(joint, law.quantity == "speed", knots, torque, np.zeros(KNOTS)))
    plant.laws = (*plant.laws, *tables)
    return plant


def compute_own_law(plant: Plant, joint: int, by_speed: bool, u: Floats) -> Floats | None:
    """Computes the torques (k,) that a plant has already in a joint at speeds or positions `u`
    (k,), with all else at the reference.

    Friction that depends on the load is no function of the speed and is not included. None where
    the plant has no torque there.
    """
    import mujoco  # noqa: PLC0415  (optional)

    data = mujoco.MjData(plant.model)
    torque = np.empty(len(u))
    state = data.qvel if by_speed else data.qpos
    for index, value in enumerate(u):
        state[joint] = value
        mujoco.mj_forward(plant.model, data)
        # MuJoCo's passive forces act on the joint; a table holds their resistance.
        torque[index] = -(data.qfrc_damper if by_speed else data.qfrc_spring)[joint]
    if by_speed:
        steady, rise, falls = plant.stribeck[:, joint]
        dry = (
            plant.friction[joint]
            + steady * (1.0 + rise * np.exp(-np.abs(u) / falls))
            + plant.hysteresis[0, joint]
        )
        torque = torque + dry * np.sign(u)
    if torque.any():
        return torque
    return None


def pack_laws(laws: tuple[JointLaw, ...]) -> tuple[Floats, Floats]:
    """Laws in the form of the compiled loop: (m, 4) joint, by speed, number of knots, turning;
    (m, 3, k) knots, values, branches.
    """
    rows = np.zeros((len(laws), 3, max((len(law.knots) for law in laws), default=0)))
    for index, law in enumerate(laws):
        rows[index, :, : len(law.knots)] = law.knots, law.values, law.branches
    return np.array(
        [[law.joint, law.by_speed, len(law.knots), law.turning] for law in laws], dtype=float
    ).reshape(-1, 4), rows


def list_sensor_effects(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Lists the effects of sensors on their readings; positions of joints are the reference for
    their clock.
    """

    def lag(plant: Plant, values: Values) -> Plant:
        plant.sensor_lag_s = values["time_constant_s"]
        return plant

    def delay(plant: Plant, values: Values) -> Plant:
        plant.sensor_delay_s += values["offset_s"]
        return plant

    if not usual.sensors:
        return
    names = tuple(usual.sensors)
    places = tuple(mechanism.sensor_values[name][0] for name in names)
    ones = np.ones(len(places))
    yield from expand_law(
        PlaceLaw(
            declared.SENSOR_GAIN_OF_MECHANISM,
            "factor",
            ("",) * len(places),
            names,
            places,
            0.5 * ones,
            2.0 * ones,
            _scale_sensor,
        )
    )
    yield from _sensor_crosstalk(mechanism, usual)
    yield _sensor_drift(mechanism, usual)
    yield declared.SENSOR_LAG_OF_MECHANISM.make_effect(
        (Parameter("time_constant_s", 0.002, 0.05, may_be_zero=False, below=0.1),),
        lag,
    )
    yield declared.CLOCK_OFFSET_OF_MECHANISM.make_effect(
        (Parameter("offset_s", -0.04, 0.04, below=0.1),),
        delay,
    )


def _sensor_crosstalk(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Crosstalk: a share of one recorded value in the reading of another; a number selects the
    pair.
    """
    pairs = list(permutations(usual.sensors, 2))

    def leak(plant: Plant, values: Values) -> Plant:
        to, source = pairs[int(values["pair"]) - 1]
        # The values may have different units, so the share refers to their usual magnitudes.
        scale = usual.sensors[to] / max(usual.sensors[source], 1e-12)
        plant.sensor_crosstalk[
            mechanism.sensor_values[to][0], mechanism.sensor_values[source][0]
        ] += values["share_relative"] * scale
        return plant

    if pairs:
        listed = ", ".join(
            f"{number}: {to} reads {source}" for number, (to, source) in enumerate(pairs, start=1)
        )
        pair = Parameter("pair", 1.0, float(len(pairs)), may_be_zero=False, whole=True)
        share = Parameter(
            "share_relative",
            -MAX_CROSSTALK_SHARE,
            MAX_CROSSTALK_SHARE,
            starts=(-0.2 * MAX_CROSSTALK_SHARE, 0.2 * MAX_CROSSTALK_SHARE),
        )
        declaration = declared.SENSOR_CROSSTALK_OF_MECHANISM
        numbered = replace(declaration, law=f"{declaration.law}; pairs {listed}")
        yield numbered.make_effect((pair, share), leak)


def _sensor_drift(mechanism: Mechanism, usual: UsualMotion) -> Effect:
    rates = {}
    for name, rms in usual.sensors.items():
        index, unit = mechanism.sensor_values[name]
        key = join_name(
            name if len(usual.sensors) > 1 else "",
            "rate",
            unit.replace(" ", "").replace("/", "_"),
            "per_s",
        )
        rates[key] = index, DRIFTS_BY * max(rms, 1e-12)

    def apply(plant: Plant, values: Values) -> Plant:
        for key, (index, _) in rates.items():
            plant.sensor_drift_per_s[index] += values[key]
        return plant

    parameters = tuple(Parameter(key, -largest, largest) for key, (_, largest) in rates.items())
    return declared.SENSOR_DRIFT_OF_MECHANISM.make_effect(parameters, apply)


def _scale_sensor(plant: Plant, sensor: int, value: float) -> None:
    plant.sensor_gain[sensor] *= value
