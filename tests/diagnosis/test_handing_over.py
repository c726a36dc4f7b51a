"""A nuisance and an effect that do the same: where a descent ends must not hang on from which side it came."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.inference.map_fit import GaussNewton, without_scatter
from rfca_rig.diagnosis.inference.nuisance_swap import _is_better, swap_nuisance
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.leg.nuisances import nuisances_of
from rfca_rig.diagnosis.leg.simulator import leg_dataset
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, recorded

SOFT = replace(RIG, effects=(present("ground_compliance", stiffness_N_per_m1p5=8600.0),))


@pytest.fixture(scope="module")
def descent():
    evidence = leg_dataset(flaps_of(recorded(SOFT, [(205.0, 2.433), (220.0, 3.249)], with_shaft=False)))
    return without_scatter(evidence)


def begun(descent, contact_stiffness, size, effect="ground_compliance"):
    """The hypothesis of a soft floor, or of another effect, with the contact that far from believed."""
    space = nuisances_of(RIG, KNOWN_TO | {"contact_stiffness_relative": 0.5}, 0.0)
    coordinates = Parameterization(space).with_terms((EffectTerm(catalogue()[effect]),))
    x = np.zeros(coordinates.size)
    x[space.names.index("contact_stiffness")], x[coordinates.nuisances] = contact_stiffness, size
    found = descent.at(coordinates, x)
    assert found is not None
    return found


def test_a_floor_that_is_soft_does_not_stay_a_contact_far_from_believed(descent):
    astray = begun(descent, -3.9, -0.46)
    found = swap_nuisance(descent, astray)
    assert np.abs(found.x[: found.coordinates.nuisances]).max() < 1.5
    assert descent.evaluate(found).log_evidence > descent.evaluate(descent.converge(astray)).log_evidence - 1.0
    assert found.coordinates.supposed(found.x).rig.effects[0].values[0][1] == pytest.approx(8600.0, rel=0.1)


def test_what_could_not_be_claimed_is_led_from_everywhere_whatever_it_promises(descent, monkeypatch):
    """A descent may stop far below where new slopes would take it; that costs nothing where the answer had to be refused."""
    astray, promising, led = begun(descent, -3.9, -0.46), begun(descent, -0.5, -0.9), begun(descent, 0.0, -1.2)
    evidence = {id(astray): 0.0, id(promising): -1000.0, id(led): 100.0}
    monkeypatch.setattr(GaussNewton, "refine", lambda *_: promising)
    monkeypatch.setattr(GaussNewton, "converge", lambda _, fitted, **_rounds: led if fitted is promising else fitted)
    monkeypatch.setattr(GaussNewton, "log_evidence", lambda _, fitted: evidence[id(fitted)])
    assert swap_nuisance(descent, astray) is led


def test_what_is_not_strained_stays_as_it_is(descent):
    found = begun(descent, -1.0, -1.2)
    assert swap_nuisance(descent, found) is found


def test_to_an_effect_that_does_nothing_of_the_kind_nothing_is_handed_over(descent):
    """Though the contact should be softer by far less, which a descent from where it is believed would show."""
    found = begun(descent, -4.0, 0.1, "tip_mass")
    assert descent.log_evidence(descent.refine(found)) > descent.log_evidence(found) + 50.0
    assert swap_nuisance(descent, found) is found


@pytest.mark.parametrize(
    ("stiffness", "gain", "better"), [(0.0, -5.0, True), (0.0, -15.0, False), (-3.7, -5.0, False), (-3.7, 5.0, True), (-4.0, 5.0, True)]
)
def test_all_but_as_likely_is_better_only_where_nothing_believed_has_to_go_as_far(descent, monkeypatch, stiffness, gain, better):
    found, again = begun(descent, -3.9, -0.46), begun(descent, stiffness, -1.2)
    monkeypatch.setattr(GaussNewton, "log_evidence", lambda _, fitted: gain if fitted is again else 0.0)
    assert _is_better(descent, again, found) == better
