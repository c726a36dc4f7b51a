"""A compliant floor in series with the nominal contact."""

from dataclasses import replace
from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import NORMAL, LawUse
from rfca_rig.model.setup import Setup, with_law

AS_THE_GROUND = 1.5
# Force at which the depth of the soft floor does not depend on its exponent: about the contact force in mid-stroke.
REFERENCE_N = 20.0
ROUNDS = 8  # of Newton's iteration at most, in logarithms: to rounding for exponents from 0.5 to 3
CONVERGED = 1e-7  # of log N: the error after the next iteration, its square, is below rounding


def force(depth: float, rate: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    """Force of the two springs in series beyond that with the ground's exponent, and its derivatives.

    parameter = (stiffness of the ground, of the soft floor, of both with the ground's exponent, exponent of the soft floor, damping of an
    end that enters, of one that leaves).
    """
    hard, both, exponent = parameter[0], parameter[2], parameter[3]
    reference_m = (REFERENCE_N / parameter[1]) ** (2.0 / 3.0)
    damping = parameter[4] if rate > 0.0 else parameter[5]
    grow = 1.0 + damping * rate
    if grow <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    plain = both * depth**1.5
    # Newton's iteration for the N at which both depths add up to the given one. In logarithms N stays positive.
    log_N, softness = np.log(plain), depth
    for _ in range(ROUNDS):
        first = np.exp((log_N - np.log(hard)) * 2.0 / 3.0)
        second = reference_m * np.exp((log_N - np.log(REFERENCE_N)) / exponent)
        softness = first * 2.0 / 3.0 + second / exponent
        step = np.log((first + second) / depth) * (first + second) / softness
        log_N -= step
        if abs(step) < CONVERGED:
            break
    N = np.exp(log_N)
    N_depth = N / softness
    return (N - plain) * grow, (N_depth - 1.5 * plain / depth) * grow, (N - plain) * damping


def apply(setup: Setup, values: Values) -> Setup:
    """Two springs in series: depths add, so k^(-2/3) adds where both are Hertz's."""
    rig, ground, stiffness = setup.rig, setup.rig.ground, values["stiffness_N_per_m1p5"]
    hard, added = (k ** (-2.0 / 3.0) for k in (ground.stiffness_N_per_m1p5, stiffness))
    both = (hard + added) ** -1.5
    softer = replace(setup, rig=replace(rig, ground=replace(ground, stiffness_N_per_m1p5=both)))
    # With equal exponents the series is one Hertz contact, and no law is needed.
    if values["exponent"] == AS_THE_GROUND:
        return softer
    leaving = ground.damping_s_per_m * ground.leaving_damping_share
    shape = (ground.stiffness_N_per_m1p5, stiffness, both, values["exponent"], ground.damping_s_per_m, leaving)
    return with_law(softer, LawUse(NORMAL, force, shape))


EFFECT = Effect(
    id="ground_compliance",
    where="ground",
    left_out="soft floor",
    law="N = F (depth / b)^p in series with the nominal contact, F = 20 N, b = (F / k)^(2/3), p = 1.5 unless given",
    source="Hertz contacts in series; an exponent of 1 for a bed of springs (Winkler), of 2 for a cone (Sneddon 1965)",
    parameters=(Parameter("stiffness_N_per_m1p5", 5000.0, 1000000.0, may_be_zero=False),),
    apply=apply,
    # At 2e5 N/m^1.5, fz over a stroke (215 mm, 2.433 rad/s) changes by 6.3 N rms with an exponent of 1, and by 2.2 N with 2.
    shape=(Parameter("exponent", 1.0, 2.0, may_be_zero=False, neutral=AS_THE_GROUND),),
    same_as="contact_stiffness",
)
