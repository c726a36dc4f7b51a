"""Inertia that turns with every joint and not with a link: a rotor behind a gear, its inertia times the gear ratio squared.

It resists the joint's acceleration, but a law is told the speed only. In the first stage of a step, an implicit Euler step of 0.29
of its length, the mean acceleration since the step began is that of the stage. At its end it is that of the parabola through this
speed and the last two, of second order like the step itself. Which of the two is asked for shows in the time elapsed, measured by the
step before; where the step's length changes so much that this fails, one step is of first order.
"""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

FIRST_STAGE = 0.54  # of the step before: halfway, by ratio, between 0.29 and 1


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    """`memory` holds the speed when the step began, the one before it, and the time between them: 0 where there is none."""
    if elapsed <= 0.0:
        return 0.0, 0.0, 0.0
    mean = (rate - memory[0]) / elapsed
    if memory[2] <= 0.0 or elapsed < FIRST_STAGE * memory[2]:
        return parameter[0] * mean, 0.0, parameter[0] / elapsed
    mean_before = (memory[0] - memory[1]) / memory[2]
    share = elapsed / (elapsed + memory[2])
    return parameter[0] * (mean + share * (mean - mean_before)), 0.0, parameter[0] * (1.0 + share) / elapsed


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0], memory[1], memory[2] = rate, memory[0], elapsed


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (values["inertia_kg_m2"],), advance))


EFFECT = Effect(
    id="joint_inertia",
    where="pendulum-like rigs",
    left_out="inertia of the motors' rotors behind their gears",
    law="T = I phi''",
    source="reflected inertia, I = gear ratio^2 rotor inertia; the rotor's spin with the link before it is left out",
    parameters=(Parameter("inertia_kg_m2", 1e-4, 0.3),),
    apply=apply,
)
