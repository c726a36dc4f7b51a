"""Laws that become equal in a limit: the declared ones do, and only there."""

import numpy as np
import pytest

from rfca_rig.diagnosis.config import LAW_ERROR
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.effects.rigs import having
from tests.model.legs import PAPER

T = np.arange(0, 660) * 1e-3  # until the leg is about to leave the floor
NOISE = np.array([[0.10], [0.15], [0.006]])  # of a sample of fy, fz in N and tx in N m
# Values in the limit, values outside of it, and the other law as fitted to the first by least
# squares
LIMITS = {
    ("hinge_coulomb_friction", "spring_hysteresis"): (
        {"torque_Nm": 0.05, "presliding_deg": 0.5},
        {"torque_Nm": 0.2, "presliding_deg": 0.06},
        {"strength_relative": 0.519, "saturation_deg": 0.511, "exponent": 2.6},
    ),
    ("spring_hysteresis", "hinge_coulomb_friction"): (
        {"strength_relative": 0.3, "saturation_deg": 1.0},
        {"strength_relative": 0.3, "saturation_deg": 5.0},
        {"torque_Nm": 0.0555, "presliding_deg": 1.0},
    ),
    ("sensor_lag", "clock_offset"): (
        {"time_constant_s": 0.004},
        {"time_constant_s": 0.02},
        {"offset_s": 0.00389},
    ),
    ("sensor_ringing", "clock_offset"): (
        {"frequency_Hz": 80.0, "damping_ratio": 0.5},
        {"frequency_Hz": 25.0, "damping_ratio": 0.05},
        {"offset_s": 0.0021},
    ),
}


def limit_of(pair):
    return next(limit for limit in catalogue()[pair[0]].equal_limits if limit.other == pair[1])


def forces(**effects):
    stroke = simulate_stroke_at_speed(having(PAPER, **effects), 0.205, 2.6, T)
    return np.array([stroke.fy_N, stroke.fz_N, stroke.tx_Nm]) / NOISE


def full(name, values):
    return {parameter.name: parameter.neutral for parameter in catalogue()[name].shape} | values


def test_every_declared_limit_is_looked_at_here():
    declared = {
        (effect.id, limit.other) for effect in catalogue().values() for limit in effect.equal_limits
    }
    assert declared == set(LIMITS)
    assert {other for _, other in declared} <= set(catalogue())


@pytest.mark.parametrize("pair", LIMITS, ids=" ".join)
def test_in_its_limit_a_law_is_the_other_one_but_for_the_error_that_laws_are_granted(pair):
    within, outside, other = LIMITS[pair]
    limit = limit_of(pair)
    assert limit.holds(full(pair[0], within)) and not limit.holds(full(pair[0], outside))
    mine = forces(**{pair[0]: within})
    theirs = forces(**{pair[1]: other})
    plain = forces()
    assert np.sqrt(np.mean((mine - theirs) ** 2)) < LAW_ERROR * np.sqrt(
        np.mean((mine - plain) ** 2)
    )
