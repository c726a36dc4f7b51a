import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.diagnosis.inference.parameterization import (
    EffectTerm,
    Parameterization,
    coordinate_of,
    std_of,
    value_of,
)
from rfca_rig.diagnosis.inference.screening import grid_of, terms_of
from rfca_rig.model.catalogue import catalogue
from tests.model.legs import PAPER

PARAMETERS = [
    p for effect in catalogue().values() for p in (*effect.parameters, *effect.shape) if not p.whole
]


@given(st.sampled_from(PARAMETERS), st.floats(-3.0, 3.0))
def test_coordinates_and_values_are_each_others_inverse(parameter, z):
    assert coordinate_of(parameter, value_of(parameter, z)) == pytest.approx(z, abs=1e-6)


@given(st.sampled_from(PARAMETERS), st.floats(-2.0, 2.0))
def test_a_standard_deviation_is_that_of_drawn_values(parameter, z):
    drawn = [value_of(parameter, z + 1e-3 * x) for x in np.random.default_rng(0).normal(size=400)]
    assert std_of(parameter, z, 1e-3) == pytest.approx(np.std(drawn), rel=0.15)


def test_most_of_the_prior_of_a_scale_lies_within_its_plausible_bounds():
    for parameter in PARAMETERS:
        if parameter.low > 0.0 and parameter.high > 2.0 * parameter.low:
            assert (
                parameter.low
                <= value_of(parameter, -4.0)
                < value_of(parameter, 4.0)
                <= parameter.high
            )


def test_effects_are_supposed_beside_nuisances_in_the_order_of_the_coordinates():
    space = make_prior(
        ["k0", "friction"], ModelPoint(PAPER), {"k0_relative": 0.03, "friction_coefficient": 0.05}
    )
    relaxation = catalogue()["spring_relaxation"]
    tilt = catalogue()["ground_tilt"]
    coordinates = Parameterization(space, (EffectTerm(relaxation), EffectTerm(tilt)))
    assert coordinates.size == 5
    assert [coordinates.part(i) for i in range(2)] == [slice(2, 4), slice(4, 5)]
    supposed = coordinates.supposed(np.array([1.0, 0.0, 0.5, -0.5, 2.0]))
    assert supposed.rig.leg.k0_Nm_per_rad == pytest.approx(PAPER.leg.k0_Nm_per_rad * np.exp(0.03))
    assert [effect.id for effect in supposed.rig.effects] == ["spring_relaxation", "ground_tilt"]
    assert dict(supposed.rig.effects[1].values)["slope"] == pytest.approx(0.1)


def test_a_shape_is_fitted_between_the_parameters_of_its_effect_and_how_that_begins():
    friction = catalogue()["hinge_coulomb_friction"]
    term = EffectTerm(friction)
    assert [parameter.name for parameter in term.free] == ["torque_Nm", "presliding_deg", "let_go"]
    assert [parameter.name for parameter in term.sizes] == ["torque_Nm"]
    values = dict(term.present(np.array([0.0, 1.0, 0.4])).values)
    assert values["presliding_deg"] == pytest.approx(value_of(friction.shape[0], 1.0))
    assert values["let_go"] == pytest.approx(0.4)


def test_a_neutral_shape_is_typical_of_its_prior_and_survives_the_coordinates():
    for parameter in (p for effect in catalogue().values() for p in effect.shape):
        z = coordinate_of(parameter, parameter.neutral)
        assert abs(z) <= 2.0
        assert value_of(parameter, z) == pytest.approx(parameter.neutral, rel=1e-12, abs=1e-15)


def test_only_the_size_of_an_effect_can_do_just_what_a_nuisance_does():
    space = make_prior(
        ["k0", "friction"], ModelPoint(PAPER), {"k0_relative": 0.03, "friction_coefficient": 0.05}
    )
    coordinates = Parameterization(space, (EffectTerm(catalogue()["ground_compliance"]),))
    assert coordinates.same_as == ["contact_stiffness", ""]


def test_an_effect_that_counts_something_is_tried_for_each_count():
    assert [dict(choice.whole)["hinge"] for choice in terms_of(catalogue()["damaged_hinge"])] == [
        2,
        3,
        4,
        5,
        6,
        7,
    ]
    assert [len(grid_of(term)) for term in terms_of(catalogue()["damaged_hinge"])] == [1] * 6
    assert all(
        [np.sign(point[0]) for point in grid_of(term)] == [-1.0, 1.0]
        for term in terms_of(catalogue()["hinge_rest_angle_of_one"])
    )
    assert terms_of(catalogue()["tip_mass"]) == (EffectTerm(catalogue()["tip_mass"]),)
