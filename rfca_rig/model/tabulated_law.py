"""A law given by a table of values: a measured law for the simulator, without a formula.

It is linear between its knots and constant beyond them. Where it acts (`place`), what it depends on
(`argument`), and its unit:

    place                argument            value
    hinges, hinge2 ...   rate_rad_s          N m that resist the turn
                         angle_rad           N m that resist the angle, beside the spring
                         spring_torque_Nm    N m of friction against the turn, by the spring's
                                             torque
    floor_friction       slip_m_s, load_N    share by which the friction coefficient is larger
    floor_normal         depth_m             N that the floor pushes more
    fy_N, fz_N, tx_Nm    reading_N or reading_Nm, time_s, shaft_angle_rad: N or N m that this
                         channel of the sensor reads too much
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Values
from rfca_rig.model.kernel.laws import HINGE, LOAD, NORMAL, SLIP, TABLE, Law, LawUse
from rfca_rig.model.parameters import LawTable
from rfca_rig.model.setup import SensorOutput, Setup

Floats = NDArray[np.float64]

TABULATED_LAW = "tabulated_law"
FIRST_HINGE = 2  # the number of the first hinge behind the shaft, which is 1
# the compiled law searches them one by one
FEWEST_KNOTS = 2
MOST_KNOTS = 200
# below this rate its sign is smoothed, or no step of the integrator would converge
SURE_OF_SIGN_RAD_S = 0.05
# depth over which a normal force builds up, so that it does not jump where the tip touches
REACH_M = 5e-5


def interpolate(x: float, parameter: Any) -> tuple[float, float]:
    """Value and slope at x of the table behind the parameters; the first parameter is its number
    of knots.
    """
    n = int(parameter[0])
    if x <= parameter[TABLE]:
        return parameter[TABLE + n], 0.0
    if x >= parameter[TABLE + n - 1]:
        return parameter[TABLE + 2 * n - 1], 0.0
    i = TABLE
    while x > parameter[i + 1]:
        i += 1
    slope = (parameter[i + n + 1] - parameter[i + n]) / (parameter[i + 1] - parameter[i])
    return parameter[i + n] + slope * (x - parameter[i]), slope


interpolate = numba.njit(interpolate, error_model="numpy")


# All laws of a place have the same signature, whichever arguments they use.
def by_rate(
    phi: float,  # noqa: ARG001
    rate: float,
    elapsed: float,  # noqa: ARG001
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,  # noqa: ARG001
    parameter: Any,
) -> tuple[float, float, float]:
    value, slope = interpolate(rate, parameter)
    return value, 0.0, slope


def by_angle(
    phi: float,
    rate: float,  # noqa: ARG001
    elapsed: float,  # noqa: ARG001
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,  # noqa: ARG001
    parameter: Any,
) -> tuple[float, float, float]:
    value, slope = interpolate(phi, parameter)
    return value, slope, 0.0


def by_spring_torque(
    phi: float,
    rate: float,
    elapsed: float,  # noqa: ARG001
    k0: float,
    k2: float,
    memory: Any,  # noqa: ARG001
    parameter: Any,
) -> tuple[float, float, float]:
    side = 1.0 if phi >= 0.0 else -1.0
    friction, slope = interpolate(side * k0 * phi * (1.0 + k2 * phi * phi), parameter)
    sign = np.tanh(rate / SURE_OF_SIGN_RAD_S)
    # Derivative of the friction by phi, through the magnitude of the spring's torque.
    by_phi = slope * side * k0 * (1.0 + 3.0 * k2 * phi * phi) * sign
    return friction * sign, by_phi, friction * (1.0 - sign * sign) / SURE_OF_SIGN_RAD_S


def friction_factor(x: float, memory: Any, parameter: Any) -> tuple[float, float]:  # noqa: ARG001
    more, slope = interpolate(x, parameter)
    # Friction of the opposite sign would drive the sliding.
    if more <= -1.0:
        return 0.0, 0.0
    return 1.0 + more, slope


def by_depth(depth: float, rate: float, memory: Any, parameter: Any) -> tuple[float, float, float]:  # noqa: ARG001
    more, slope = interpolate(depth, parameter)
    left = np.exp(-depth / REACH_M)
    return more * (1.0 - left), slope * (1.0 - left) + more * left / REACH_M, 0.0


@dataclass(frozen=True)
class LawKind:
    """One line of the table above: `where` as in an effect, units of argument and value ("" for
    none), and how it changes a setup.
    """

    where: str
    argument_unit: str
    unit: str
    apply: Callable[[Setup, LawTable], Setup]


def kind_of(place: str, argument: str) -> LawKind:
    """Kind of a law at this place with this argument. Raises BadInput for a place or an argument
    that is not in the table above.
    """
    family = "hinge" if _is_hinge(place) else place
    kinds = _KINDS.get(family)
    if kinds is None:
        places = "hinges, hinge2 and on, floor_friction, floor_normal, fy_N, fz_N, tx_Nm"
        raise BadInput(f"{TABULATED_LAW}: place {place!r} is not known; there are {places}")
    if argument not in kinds:
        raise BadInput(
            f"{TABULATED_LAW}: at {place} a law cannot depend on {argument!r}; it can on "
            f"{', '.join(kinds)}"
        )
    return kinds[argument]


def check_table(table: LawTable) -> LawKind:
    """Checks a table and returns its kind. Raises BadInput, in one line, for one that cannot be
    simulated.
    """
    kind = kind_of(table.place, table.argument)
    of = f"{TABULATED_LAW} of {table.argument} at {table.place}"
    if len(table.knots) != len(table.values):
        raise BadInput(
            f"{of}: {len(table.knots)} knots, but {len(table.values)} values; give one "
            "value per knot"
        )
    if not FEWEST_KNOTS <= len(table.knots) <= MOST_KNOTS:
        raise BadInput(f"{of}: {len(table.knots)} knots; give {FEWEST_KNOTS} to {MOST_KNOTS}")
    if not np.isfinite((*table.knots, *table.values)).all():
        raise BadInput(f"{of}: a knot or value is no finite number")
    steps = np.diff(table.knots)
    if (steps <= 0.0).any():
        i = int(np.argmax(steps <= 0.0))
        raise BadInput(
            f"{of}: knot {i + 2} ({table.knots[i + 1]:g}) is not above the one before "
            f"({table.knots[i]:g}); sort them"
        )
    if table.place == "floor_friction" and min(table.values) < -1.0:
        raise BadInput(
            f"{of}: value {min(table.values):g} would turn friction round; -1 takes it "
            "away, give no less"
        )
    return kind


def effect_of_table(table: LawTable | None) -> Effect:
    """The effect that simulates the table. Raises BadInput where there is none, or none that can
    be simulated.
    """
    if table is None:
        raise BadInput(
            f"effect {TABULATED_LAW}: takes place, argument, knots and values, was given "
            "none of them"
        )
    kind = check_table(table)

    def apply(setup: Setup, values: Values) -> Setup:  # noqa: ARG001
        return kind.apply(setup, table)

    return Effect(
        TABULATED_LAW,
        kind.where,
        f"a law of {table.argument} at {table.place}",
        "tabulated",
        "measured",
        (),
        apply,
    )


def _is_hinge(place: str) -> bool:
    """Whether the place is all hinges, or a numbered one."""
    return place == "hinges" or place.removeprefix("hinge").isdecimal()


def _use(place: int, law: Law, table: LawTable, only: int = -1) -> LawUse:
    return LawUse(place, law, (float(len(table.knots)),), None, only, (*table.knots, *table.values))


def _in_hinges(law: Law, setup: Setup, table: LawTable) -> Setup:
    if table.argument == "spring_torque_Nm" and setup.rig.leg.torque_splines:
        raise BadInput(
            f"{TABULATED_LAW}: a law of {table.argument} is computed from k0 and k2, and "
            "the hinges of this leg follow a measured curve "
            "(leg.torque_rotation); take the argument angle_rad"
        )
    number = table.place.removeprefix("hinge")
    last = len(setup.rig.leg.link_lengths_m)
    if number.isdecimal() and not FIRST_HINGE <= int(number) <= last:
        raise BadInput(
            f"{TABULATED_LAW}: {table.place} is not there; this rig has {FIRST_HINGE} to {last}"
        )
    # In the chain, link 0 is the shaft's, so the first hinge has the index 1.
    only = int(number) - FIRST_HINGE + 1 if number.isdecimal() else -1
    return replace(setup, laws=(*setup.laws, _use(HINGE, law, table, only)))


def _at_floor(place: int, law: Law, setup: Setup, table: LawTable) -> Setup:
    return replace(setup, laws=(*setup.laws, _use(place, law, table)))


def _read(argument: Callable[[SensorOutput, str], Floats], setup: Setup, table: LawTable) -> Setup:
    def change(felt: SensorOutput) -> SensorOutput:
        more = np.interp(argument(felt, table.place), table.knots, table.values)
        channels: dict[str, Floats] = {table.place: getattr(felt, table.place) + more}
        return replace(felt, **channels)

    return replace(setup, sensor_changes=(*setup.sensor_changes, change))


def _hinge(argument_unit: str, law: Law) -> LawKind:
    return LawKind("hinges", argument_unit, "N m", partial(_in_hinges, law))


def _channel(unit: str) -> dict[str, LawKind]:
    return {
        f"reading_{unit.replace(' ', '')}": LawKind("sensor", unit, unit, partial(_read, getattr)),
        "time_s": LawKind("sensor", "s", unit, partial(_read, lambda felt, _: felt.t_s)),
        "shaft_angle_rad": LawKind(
            "sensor", "rad", unit, partial(_read, lambda felt, _: felt.shaft_rad)
        ),
    }


_KINDS: dict[str, dict[str, LawKind]] = {
    "hinge": {
        "rate_rad_s": _hinge("rad/s", by_rate),
        "angle_rad": _hinge("rad", by_angle),
        "spring_torque_Nm": _hinge("N m", by_spring_torque),
    },
    "floor_friction": {
        "slip_m_s": LawKind("ground", "m/s", "", partial(_at_floor, SLIP, friction_factor)),
        "load_N": LawKind("ground", "N", "", partial(_at_floor, LOAD, friction_factor)),
    },
    "floor_normal": {"depth_m": LawKind("ground", "m", "N", partial(_at_floor, NORMAL, by_depth))},
    "fy_N": _channel("N"),
    "fz_N": _channel("N"),
    "tx_Nm": _channel("N m"),
}
