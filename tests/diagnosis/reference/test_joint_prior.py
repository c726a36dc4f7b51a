"""A prior with correlations has standard normal coordinates, as every other prior has."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.space import FitParameter, JointNormal, Prior


@dataclass(frozen=True)
class Two:
    """A shifted value and a relative one."""

    offset: float = 1.0
    scale: float = 2.0


OFFSET = FitParameter(
    "offset", "m", False, 1.0, lambda at: at.offset, lambda at, v: replace(at, offset=v)
)
SCALE = FitParameter(
    "scale", "", True, 0.1, lambda at: at.scale, lambda at, v: replace(at, scale=v)
)
PLAIN = Prior((OFFSET, SCALE), Two(), np.array([0.5, 0.1]), np.ones(2, dtype=bool))
MEAN = np.array([1.0, -0.5])
COVARIANCE = np.array([[0.25, -0.18], [-0.18, 0.16]])
JOINT = replace(PLAIN, joint=JointNormal(MEAN, COVARIANCE))


def test_drawn_coordinates_have_the_mean_and_the_covariance_of_the_distribution():
    drawn = np.random.default_rng(1).standard_normal((20000, 2))
    deviations = np.array([JOINT.deviations(x) for x in drawn])
    assert deviations.mean(axis=0) == pytest.approx(MEAN, abs=0.02)
    assert np.cov(deviations.T) == pytest.approx(COVARIANCE, abs=0.01)


def test_values_are_those_of_the_deviations():
    x = np.array([0.3, -1.2])
    assert JOINT.values(x) == pytest.approx(PLAIN.values(JOINT.deviations(x)))
    assert JOINT.at(np.zeros(2)).offset == pytest.approx(1.5)
    assert JOINT.centres == pytest.approx([1.5, 2.0 * np.exp(-0.05)])


def test_a_coordinate_is_closest_to_the_parameter_whose_number_it_has():
    covariance = JOINT.joint.std * JOINT.joint.correlation_root.T
    correlation = covariance / JOINT.joint.std
    assert correlation[0, 0] > abs(correlation[1, 0])
    assert correlation[1, 1] > abs(correlation[0, 1])
    assert correlation == pytest.approx(correlation.T)


def test_standard_deviations_of_the_prior_itself_are_those_of_the_distribution():
    std = JOINT.std_in_units(np.zeros(2), np.eye(2))
    assert std == pytest.approx(JOINT.prior_std)
    assert std[0] == pytest.approx(0.5 * 0.5)


def test_derivatives_are_converted_both_ways():
    jacobian = np.random.default_rng(2).standard_normal((7, 2))
    per_deviation = JOINT.per_deviation(jacobian)
    x = np.array([0.2, 0.4])
    change = JOINT.deviations(x) - JOINT.deviations(np.zeros(2))
    assert per_deviation @ change == pytest.approx(jacobian @ x)
    assert JOINT.per_coordinate(per_deviation) == pytest.approx(jacobian)


def test_a_value_below_its_lowest_one_is_raised_and_the_other_stays():
    lowest = replace(JOINT, parameters=(replace(OFFSET, lowest=1.4), SCALE))
    x = np.array([-2.0, 0.5])
    raised = lowest.values(lowest.clip(x))
    assert raised[0] == pytest.approx(1.4)
    assert raised[1] == pytest.approx(lowest.values(x)[1])


def test_without_a_joint_distribution_nothing_differs():
    x = np.array([0.3, -1.2])
    assert PLAIN.deviations(x) is x
    assert PLAIN.prior_shifts(x) is x
