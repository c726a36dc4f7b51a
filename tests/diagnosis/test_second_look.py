"""What is found from the values that are believed, where the search has gone astray."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from rfca_rig.diagnosis.data.dataset import make_dataset
from rfca_rig.diagnosis.inference.forward_selection import no_worse_than_nested
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.nuisances import nuisances_of
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.inference.restart_from_prior import (
    RESCALED,
    NominalFit,
    _gains,
    _promising_together,
    fits_worse_than_unknown,
    is_adequate,
    pairs_from_belief,
    singles_from_belief,
)
from rfca_rig.diagnosis.inference.screening import EffectProbe, Projection
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, recorded

HEAVY = present("tip_mass", mass_g=50.0)
LEAKING = present("sensor_crosstalk", fz_per_fy=0.2)
RIVALS = ("tip_mass", "sensor_crosstalk", "fluid_drag", "sensor_lag", "hinge_backlash", "gravity_tilt")


@pytest.fixture(scope="module")
def descent():
    flaps = flaps_of(recorded(replace(RIG, effects=(HEAVY, LEAKING)), [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)], with_shaft=False))
    evidence = make_dataset(flaps)
    return without_scatter(evidence)


@pytest.fixture(scope="module")
def coordinates():
    return Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))


@pytest.fixture(scope="module")
def belief(descent, coordinates):
    believed = descent.at(coordinates, np.zeros(coordinates.size))
    return NominalFit(believed, descent.evidence, tuple(EffectTerm(catalogue()[name]) for name in RIVALS))


def names(fitted):
    return {choice.effect.id for choice in fitted.coordinates.choices}


def test_both_effects_are_found_at_once_from_what_is_believed(descent, belief):
    best = max(pairs_from_belief(descent, belief), key=descent.log_evidence)
    assert names(best) == {"tip_mass", "sensor_crosstalk"}
    values = {e.id: e.values[0][1] for e in best.coordinates.supposed(best.x).rig.effects}
    assert values["tip_mass"] == pytest.approx(50.0, rel=0.1)
    assert values["sensor_crosstalk"] == pytest.approx(0.2, rel=0.1)
    assert is_adequate(descent, best)


def test_the_larger_one_is_the_best_that_is_found_alone_and_does_not_explain(descent, belief):
    best = max(singles_from_belief(descent, belief), key=descent.log_evidence)
    assert names(best) == {"tip_mass"}
    assert not is_adequate(descent, best)


def test_a_fit_is_lost_that_explains_next_to_nothing(descent, belief):
    assert fits_worse_than_unknown(descent, descent.refine(belief.fitted))
    assert not fits_worse_than_unknown(descent, max(pairs_from_belief(descent, belief), key=descent.log_evidence))


def trials_of(signatures):
    """Two trials of one effect, and one of each of two others."""
    effects = [catalogue()[name] for name in ("tip_mass", "tip_mass", "fluid_drag", "sensor_lag")]
    return [EffectProbe(EffectTerm(effect), np.zeros(1), signature) for effect, signature in zip(effects, signatures, strict=True)]


@pytest.fixture
def signatures():
    return np.random.default_rng(5).normal(size=(4, 30))


def plain(target):
    """A projection without nuisances, in units of noise already."""
    return Projection(lambda x: x, np.zeros((len(target), 1)), np.eye(1), target)  # type: ignore[arg-type]


def test_two_trials_together_take_away_what_least_squares_says(signatures):
    target = 0.7 * signatures[0] + 1.4 * signatures[2] + 0.3 * np.random.default_rng(6).normal(size=30)
    gains = _gains(plain(target), trials_of(signatures))
    factors, rest = nnls(signatures[[0, 2]].T, target)
    assert factors.max() < RESCALED
    assert gains[0, 2] == pytest.approx(target @ target - rest**2)
    assert np.allclose(gains, gains.T)


def test_no_pair_is_one_effect_twice(signatures):
    ranked = _promising_together(plain(signatures.sum(axis=0)), trials_of(signatures))
    assert len(ranked) == 3
    assert all(one.choice.effect.id != other.choice.effect.id for one, other in ranked)


def test_pairs_that_promise_next_to_nothing_are_not_fitted(signatures):
    trials, own = trials_of(signatures), np.random.default_rng(7).normal(size=30)
    own -= signatures.T @ np.linalg.lstsq(signatures.T, own, rcond=None)[0]
    little = 0.2 * np.linalg.norm(own) / np.linalg.norm(signatures.sum(axis=0))
    assert _promising_together(plain(own + little * signatures.sum(axis=0)), trials) == []
    assert _promising_together(plain(own + 5.0 * little * signatures.sum(axis=0)), trials)


@pytest.mark.slow
def test_a_part_that_went_astray_is_fitted_again_beside_what_lacks_nothing(descent, belief):
    """The heavy tip alone, left where no descent would take it; the pair that it is part of must not win because of that."""
    pair = max(pairs_from_belief(descent, belief), key=descent.log_evidence)
    base = descent.refine(belief.fitted)
    alone = next(single for single in singles_from_belief(descent, belief) if names(single) == {"tip_mass"})
    astray = descent.at(alone.coordinates, alone.x - 3.0 * (np.arange(len(alone.x)) == alone.coordinates.nuisances))
    assert astray is not None and descent.log_evidence(astray) < descent.log_evidence(alone) - 100.0
    again = no_worse_than_nested(descent, base, [astray], [pair])
    tips = [single for single in again if names(single) == {"tip_mass"}]
    assert len(tips) == 1 and descent.log_evidence(tips[0]) > descent.log_evidence(alone) - 1.0


def test_what_was_looked_at_already_is_not_looked_at_again(descent, belief):
    looked = (belief.trials[0],)
    assert replace(belief, looked=looked).trials is looked
