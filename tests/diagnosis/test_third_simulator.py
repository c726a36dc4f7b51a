"""A simulator that the package does not know, diagnosed through the interface alone."""

from math import exp

import numpy as np
import pytest

from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.simulator import make_dataset
from tests.diagnosis.oscillator import (
    CATALOGUE,
    OscillatorSimulator,
    Shaking,
    nuisance_space,
    recorded,
)


def diagnosed(friction):
    shaken = [Shaking(force, rate) for force in (2.0, 4.0) for rate in (4.0, 7.0, 9.0)]
    conditions = [recorded(condition, friction, seed) for seed, condition in enumerate(shaken)]
    dataset = make_dataset(conditions, OscillatorSimulator())
    found = search_models(
        dataset, Parameterization(nuisance_space()), list(CATALOGUE.values()), lambda *_: None
    )
    return decide(found)


def test_friction_of_another_law_is_identified_in_a_rig_that_the_core_does_not_know():
    """Rounder than the catalogue's where the mass turns back, and 10 % more at low speed."""
    decision = diagnosed(
        lambda v: 0.4 * v / np.hypot(v, 0.012) * (1.0 + 0.1 * exp(-((v / 0.1) ** 2)))
    )
    (effect,) = decision.effects
    assert decision.grade in ("identified", "mostly") and effect.id == "coulomb"
    assert effect.parameters["friction_N"].value == pytest.approx(0.4, rel=0.1)


def test_where_nothing_is_concealed_nothing_is_stated():
    decision = diagnosed(lambda _: 0.0)
    assert decision.grade == "nothing missing" and decision.effects == ()


@pytest.mark.slow
def test_a_force_that_no_effect_of_the_catalogue_makes_is_left_unexplained():
    """A steady push. The search comes as far as sets of three effects."""
    decision = diagnosed(lambda _: 0.5)
    assert decision.grade == "unexplained" and decision.effects == ()
