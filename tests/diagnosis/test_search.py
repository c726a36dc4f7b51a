"""Steps of the search over hypotheses, each from a standing that is set by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.diagnosis.data.dataset import make_dataset
from rfca_rig.diagnosis.data.stages import stage_tables
from rfca_rig.diagnosis.data.static_history import MOVES, with_free_friction
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, without_scatter
from rfca_rig.diagnosis.inference.model_selection import (
    CLEARLY_BETTER,
    POLISHED_BEST,
    SearchState,
    _begun,
    _beside_what_lacks_nothing,
    _best_polished,
    _learnt_at_last,
    _with_nothing_again,
    _with_pairs,
    _with_singles,
    search_models,
)
from rfca_rig.diagnosis.inference.nuisances import nuisances_of
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.inference.restart_from_prior import NominalFit
from rfca_rig.diagnosis.inference.screening import probe_effects
from rfca_rig.diagnosis.likelihood.repeat_scatter import Scatter
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, read_at_rest, recorded

CONDITIONS = [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)]
BRISKLY, SOFTLY = MOVES[0], MOVES[2]
HEAVY = present("tip_mass", mass_g=50.0)


def standing_of(effects, astray):
    """The best fit of a heavier tip to a leg with these effects, and beside it nothing missing left where no descent took it."""
    flaps = flaps_of(recorded(replace(RIG, effects=effects), CONDITIONS, with_shaft=False))
    evidence = make_dataset(flaps)
    descent = without_scatter(evidence)
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))
    believed = descent.at(coordinates, np.zeros(coordinates.size))
    trials = probe_effects(evidence, believed, [EffectTerm(catalogue()["tip_mass"])])
    wider = coordinates.with_terms([trials[0].choice])
    single = descent.converge(descent.refine(descent.at(wider, np.concatenate([believed.x, trials[0].z]), believed.jacobian)))
    base = descent.at(coordinates, believed.x + astray)
    return SearchState(descent, Scatter({}, np.empty((len(evidence.rows.measured), 0))), base, (single,)), trials


@pytest.fixture(scope="module")
def plain():
    return standing_of((), 2.0)


def test_a_name_does_not_lead_because_nothing_missing_was_left_astray(plain):
    standing, trials = plain
    descent = standing.descent
    assert descent.log_evidence(standing.singles[0]) > descent.log_evidence(standing.base) + 100.0
    found = _beside_what_lacks_nothing(standing, trials)
    assert descent.log_evidence(found.base) > descent.log_evidence(standing.singles[0]) - CLEARLY_BETTER


def test_nothing_missing_is_fitted_again_from_where_the_best_explanation_came_to_stand(plain):
    standing, _ = plain
    descent = standing.descent
    found = _with_nothing_again(standing)
    assert descent.log_evidence(found.base) > descent.log_evidence(standing.singles[0]) - CLEARLY_BETTER
    assert _with_nothing_again(found) is found


@pytest.mark.parametrize(("lost", "polished"), [(True, POLISHED_BEST), (False, 1)])
def test_where_all_are_lost_the_best_few_are_polished_however_far_below(plain, monkeypatch, lost, converge):
    standing, _ = plain
    fits = [replace(standing.singles[0]) for _ in range(4)]
    evidence = {id(fitted): -1000.0 * place for place, fitted in enumerate(fits)}
    seen = []
    monkeypatch.setattr("rfca_rig.diagnosis.inference.model_selection.is_lost", lambda *_: lost)
    monkeypatch.setattr(GaussNewton, "log_evidence", lambda _, fitted: evidence[id(fitted)])
    monkeypatch.setattr(GaussNewton, "polished", lambda _, fitted: seen.append(fitted) or fitted)
    assert _best_polished(standing.descent, fits[::-1]) == fits
    assert seen == fits[:converge]


def test_what_is_missing_leads_still():
    standing, trials = standing_of((HEAVY,), 2.0)
    found = _beside_what_lacks_nothing(standing, trials)
    descent = standing.descent
    best = max(found.singles, key=descent.log_evidence)
    assert descent.log_evidence(best) > descent.log_evidence(found.base) + CLEARLY_BETTER
    (mass,) = [e.values[0][1] for e in best.coordinates.supposed(best.x).rig.effects]
    assert mass == pytest.approx(50.0, rel=0.1)


@pytest.mark.parametrize(("poor_from", "begun_anew"), [(0.0, True), (0.015, False)])
def test_what_explains_with_a_large_error_of_the_model_is_not_the_end_of_the_search(monkeypatch, poor_from, begun_anew):
    seen = []
    monkeypatch.setattr("rfca_rig.diagnosis.inference.model_selection.POOR_FIT", poor_from)
    monkeypatch.setattr("rfca_rig.diagnosis.inference.model_selection.grown", lambda _, fits: seen.extend(fits) or [])
    evidence = make_dataset(flaps_of(recorded(replace(RIG, effects=(HEAVY,)), CONDITIONS, with_shaft=False)))
    found = search_models(evidence, Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0)), [catalogue()["tip_mass"]], lambda *_: None)
    assert found.named[0].ids == ("tip_mass",) and bool(seen) == begun_anew


LEAKING = present("sensor_crosstalk", fz_per_fy=0.2)


def searched_among(effects, rivals):
    """A search that has looked at these rivals; a static table, moved through softly, belongs to the recordings of such a leg."""
    rig = replace(RIG, effects=effects)
    stages = read_at_rest(Supposed(rig), SOFTLY, (60.0, 80.0, 100.0, 120.0))
    evidence = make_dataset([*flaps_of(recorded(rig, CONDITIONS, with_shaft=False)), *stage_tables(stages, {}, BRISKLY)])
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))
    believed, standing = _begun(with_free_friction(evidence), coordinates)
    choices = tuple(EffectTerm(catalogue()[name]) for name in rivals)
    trials = probe_effects(standing.descent.evidence, standing.base, choices)
    return standing, trials, NominalFit(believed, standing.descent.evidence, choices)


def test_how_a_table_was_moved_through_is_learnt_from_what_fits_well():
    standing, trials, belief = searched_among((HEAVY,), ["tip_mass"])
    found = _with_singles(standing, standing.base, trials, belief, True)
    assert found.learnt and {table.moves for table in found.descent.evidence.tables} == {SOFTLY}


def test_it_is_not_learnt_from_half_of_what_is_missing_but_from_all_of_it():
    standing, trials, belief = searched_among((HEAVY, LEAKING), ["tip_mass", "sensor_crosstalk"])
    found = _with_singles(standing, standing.base, trials, belief, True)
    assert not found.learnt and _learnt_at_last(found, True) is found
    found = _learnt_at_last(_with_pairs(found, trials), True)
    assert found.learnt and {table.moves for table in found.descent.evidence.tables} == {SOFTLY}
