"""The leg of an FMU: which effects it can have, its numbers as one block, and the values of the rig
that stay open as parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.export.fmu_code import LegMemory, MemoryLayout, Stepping, lay_out
from rfca_rig.export.fmu_description import START_ANGLE, OpenParameter, Use, Variable
from rfca_rig.model.catalogue import resolve_effect, set_up
from rfca_rig.model.chain import (
    Tolerance,
    allocate_samples,
    allocate_workspace_of,
    make_unloaded_state,
)
from rfca_rig.model.kernel.state import Shaft
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import Setup, add_drive

Floats = NDArray[np.float64]
ShaftInput = Literal["speed", "torque"]

# A parameter's effect on the numbers of the leg is found by varying it by this share.
VARIATION = 0.1
# Numbers that follow from a parameter agree with a straight line to rounding.
STRAIGHT = 1e-12


def _stand(rig: RigModel) -> ShaftMotion:
    """A shaft that stands, in place of the motion, which is the input of an FMU."""
    return ramp_to_speed(rig.leg.start_angle_rad, 0.0, 1.0, 1.0)


def set_up_leg(rig: RigModel, height_m: float) -> Setup:
    """The leg with all its effects and its shaft at rest. Raises BadInput as `set_up`."""
    return set_up(rig, height_m, _stand(rig))


def check_effects(rig: RigModel, height_m: float, shaft_input: ShaftInput) -> None:
    """Raises BadInput for the first effect that an FMU cannot have."""
    if rig.swing is not None:
        raise BadInput("the model swings before the stroke; an FMU begins at rest")
    for present in rig.effects:
        if reason := _why_not(rig, present, height_m, shaft_input):
            raise BadInput(
                f"effect {present.id}: {reason}; leave the effect out of the rig file or model file"
            )


def _why_not(
    rig: RigModel, present: PresentEffect, height_m: float, shaft_input: ShaftInput
) -> str | None:
    """Why an FMU cannot have this effect; None if it can."""
    still = _stand(rig)
    alone = set_up(replace(rig, effects=(present,)), height_m, still)
    effect, _ = resolve_effect(present)
    if alone.sensor_changes:
        return "changes readings of the force sensor, and an FMU has the forces themselves"
    if alone.motion is not still:
        return "changes a motion that is known beforehand, and that of an FMU is its input"
    if effect.needs_order:
        return "depends on the number of strokes before, which an FMU does not count"
    if alone.drive is not None and shaft_input == "torque":
        return "is a drive between command and shaft, which --input torque replaces"
    return None


def lay_out_leg(setup: Setup, shaft_input: ShaftInput) -> MemoryLayout:
    """The block of numbers with the leg before its rest pose is known."""
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    # Addresses of this process mean nothing in another; the program in C fills in its own.
    none = np.zeros(laws.place.size, dtype=np.int64)
    laws = laws._replace(address=none, advance=none)
    start_rad = setup.motion.start_rad
    # One piece of motion at a time, which begins with a landing or has none.
    still = np.array([[start_rad, 0.0, 0.0, 0.0]])
    shaft = Shaft(np.zeros(2), still, np.zeros(1), False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if setup.drive is not None:
        shaft = add_drive(shaft, setup.drive, start_rad)
    elif shaft_input == "torque":
        shaft = shaft._replace(free=True)
    state = make_unloaded_state(chain, start_rad, laws)
    usual = Tolerance()
    memory = LegMemory(
        chain,
        laws,
        shaft,
        state,
        allocate_workspace_of(chain),
        allocate_samples(np.zeros(1), state.q.size, state.anchor.size),
        Stepping(
            span=np.zeros(2),
            next_step=np.zeros(1),
            longest_step=usual.longest_s,
            most_steps=float(usual.most_steps),
            tolerance=usual.bounds,
        ),
    )
    # Samples are not initialised; the file should not depend on what was in the memory.
    for column in memory.samples:
        column.fill(0.0)
    return lay_out(memory)


@dataclass(frozen=True)
class _Candidate:
    """A value of the rig that could be open, with its least value; `set_up` is the leg with another
    value.
    """

    variable: Variable
    value: float
    least: float
    set_up: Callable[[float], Setup]


def _list_candidates(rig: RigModel, height_m: float) -> list[_Candidate]:
    leg = rig.leg
    ground = rig.ground

    def change_leg(key: str) -> Callable[[float], Setup]:
        def set_up_changed(value: float) -> Setup:
            changed: dict[str, Any] = {key: value}
            return set_up_leg(replace(rig, leg=replace(leg, **changed)), height_m)

        return set_up_changed

    def change_ground(key: str) -> Callable[[float], Setup]:
        def set_up_changed(value: float) -> Setup:
            changed: dict[str, Any] = {key: value}
            return set_up_leg(replace(rig, ground=replace(ground, **changed)), height_m)

        return set_up_changed

    candidates = [
        _Candidate(
            Variable("height_m", "m", "Height of the shaft above the ground"),
            height_m,
            0.0,
            lambda value: set_up_leg(rig, value),
        ),
        _Candidate(START_ANGLE, leg.start_angle_rad, -np.inf, change_leg("start_angle_rad")),
        _Candidate(
            Variable("k0_Nm_per_rad", "N.m/rad", "Stiffness of a hinge at rest; scales its curve"),
            leg.k0_Nm_per_rad,
            0.0,
            change_leg("k0_Nm_per_rad"),
        ),
        _Candidate(
            Variable("hinge_damping_Nm_s_per_rad", "N.m.s/rad", "Damping of a hinge"),
            leg.hinge_damping_Nm_s_per_rad,
            0.0,
            change_leg("hinge_damping_Nm_s_per_rad"),
        ),
        _Candidate(
            Variable("contact_stiffness_N_per_m1p5", "N/m1.5", "Stiffness of the ground"),
            ground.stiffness_N_per_m1p5,
            0.0,
            change_ground("stiffness_N_per_m1p5"),
        ),
        _Candidate(
            Variable("contact_damping_s_per_m", "s/m", "Damping of the ground"),
            ground.damping_s_per_m,
            0.0,
            change_ground("damping_s_per_m"),
        ),
        _Candidate(
            Variable("friction_coefficient", "", "Coefficient of friction of the ground"),
            ground.friction_coefficient,
            0.0,
            change_ground("friction_coefficient"),
        ),
    ]
    if not leg.torque_splines:
        k2 = Variable("k2_per_rad2", "1/rad2", "Hardening of a hinge: k0 phi (1 + k2 phi^2)")
        candidates.append(_Candidate(k2, leg.k2_per_rad2, -np.inf, change_leg("k2_per_rad2")))
    return candidates


def find_parameters(
    rig: RigModel, height_m: float, layout: MemoryLayout, shaft_input: ShaftInput
) -> tuple[OpenParameter, ...]:
    """The values that are open: those on which the numbers of the leg depend along straight lines,
    with all effects.
    """
    parameters = []
    taken: set[int] = set()
    for candidate in _list_candidates(rig, height_m):
        uses = _find_uses(layout, shaft_input, candidate)
        places = {use.at for use in uses or ()}
        if uses is None or places & taken:
            # An effect computes something else from the value, so it stays as it is.
            continue
        taken |= places
        parameters.append(OpenParameter(candidate.variable, candidate.value, candidate.least, uses))
    if shaft_input == "torque":
        rotor = layout.slot("shaft", "rotor").offset
        variable = Variable("rotor_kg_m2", "kg.m2", "Inertia of the drive, at the shaft")
        parameters.append(OpenParameter(variable, 0.0, 0.0, (Use(rotor, 0.0, 1.0),)))
    return tuple(parameters)


def _find_uses(
    layout: MemoryLayout, shaft_input: ShaftInput, candidate: _Candidate
) -> tuple[Use, ...] | None:
    """How the numbers depend on a value; None where the dependence is not a straight line."""
    step = VARIATION * (abs(candidate.value) or 1.0)

    def numbers_at(value: float) -> Floats:
        return lay_out_leg(candidate.set_up(value), shaft_input).numbers

    here = layout.numbers
    further = numbers_at(candidate.value + step)
    nearer = numbers_at(candidate.value + 0.5 * step)
    if further.size != here.size or nearer.size != here.size:
        return None
    uses = []
    for at in np.flatnonzero((further != here) | (nearer != here)).tolist():
        # The program in C begins every simulation by writing these itself.
        if candidate.variable is START_ANGLE and _follows_start_angle(layout, at):
            continue
        slope = float(further[at] - here[at]) / step
        expected = here[at] + 0.5 * step * slope
        if not abs(nearer[at] - expected) <= STRAIGHT * max(abs(expected), abs(here[at])):
            return None
        uses.append(Use(at, float(here[at]) - slope * candidate.value, slope))
    return tuple(uses)


def _follows_start_angle(layout: MemoryLayout, at: int) -> bool:
    slots = [layout.slot("state", "q"), layout.slot("shaft", "coefficient")]
    slots.append(layout.slot("shaft", "angle"))
    return any(slot.offset <= at < slot.offset + slot.size for slot in slots)
