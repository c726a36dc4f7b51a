"""What has changed in a rig whose model is wrong throughout: a steady push that no effect makes.

The rig is one that the package does not know, so that the reference needs the interface alone.
"""

from dataclasses import dataclass, replace
from unittest.mock import Mock

import numpy as np
import pytest

from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.decision.decision import HELD_OUT, PLAUSIBLE, PROBABLE, Decision
from rfca_rig.diagnosis.problem import Problem, RecordingPair
from rfca_rig.diagnosis.reference import problem
from rfca_rig.diagnosis.reference.conditions import ReferenceParts, compare_with_reference
from rfca_rig.diagnosis.reference.fit import fit_reference
from rfca_rig.diagnosis.reference.matching import name_signals
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.diagnosis.result import Criterion
from rfca_rig.diagnosis.simulator import make_dataset
from rfca_rig.errors import SimulationFailed
from tests.diagnosis.oscillator import (
    CATALOGUE,
    OscillatorSimulator,
    Shaking,
    nuisance_space,
    recorded,
)

PUSH_N = 0.5
SHAKEN = tuple(Shaking(force, rate) for force in (2.0, 4.0) for rate in (4.0, 7.0, 9.0))
OTHERS = tuple(Shaking(force, rate) for force in (3.0, 5.0) for rate in (5.0, 6.0, 8.0))
FRICTION_N = 0.4


def push(_):
    """The model's error, in reference and recordings."""
    return PUSH_N


def push_and_friction(v):
    return PUSH_N + FRICTION_N * v / np.hypot(v, 0.012)


@dataclass(frozen=True)
class OneRecording:
    """A condition that is a recording of its own, with a repeat's number in its name."""

    condition: Shaking
    name: str

    @property
    def repeats(self):
        return self.condition.repeats

    def rows(self):
        rows = self.condition.rows()
        labels = tuple(replace(label, recording=self.name) for label in rows.labels)
        return replace(rows, labels=labels)


class RecordingSimulator(OscillatorSimulator):
    """Simulates the condition of a recording."""

    def simulate(self, at, condition):
        return super().simulate(at, condition.condition)


def rub(v):
    """What the model lacks in reference and recordings: rounder than the catalogue's law."""
    return FRICTION_N * v / np.hypot(v, 0.012)


def record(shaken, friction, repeats=1, seed=0, mass_kg=1.0):
    """Each condition as often as `repeats` says, with noise of its own."""
    parts = []
    for number, condition in enumerate(shaken):
        for repeat in range(repeats):
            done = recorded(condition, friction, [seed, number, repeat], mass_kg)
            parts.append(OneRecording(done, f"{number} repeat {repeat}"))
    return make_dataset(parts, RecordingSimulator())


def make_pair(new, reference, space=None):
    return RecordingPair(
        new=new,
        reference=reference,
        space=space or nuisance_space(),
        free=frozenset(),
        effects=tuple(CATALOGUE.values()),
        config=DEFAULT_SEARCH,
        solve=lambda _: Mock(),
        clear_proposal=lambda _: (),
        name_commands=name_signals,
        is_one_recording=False,
        conditions=len(new.parts),
    )


def decided(new, reference, parts=None, space=None):
    """The decision about the change, through the problem that every kind of rig uses."""
    of_rig = Mock(spec=Problem)
    of_rig.pair_with.return_value = make_pair(new, reference, space)
    of_rig.recordings = ()
    compared = ReferenceProblem(of_rig, of_rig, parts or ReferenceParts())
    return compared.solve((), lambda *_: None)


@pytest.fixture(scope="module")
def reference():
    return record(SHAKEN, push, repeats=2, seed=1)


def test_the_error_of_the_model_is_no_change(reference):
    solution = decided(record(SHAKEN, push, seed=2), reference)
    assert solution.finding.decision.grade == "nothing missing"
    assert all(part.matches for part in solution.compared.parts)


def test_a_change_beside_the_error_is_identified_with_its_size(reference):
    solution = decided(record(SHAKEN, push_and_friction, seed=2), reference)
    decision = solution.finding.decision
    assert decision.grade == "identified"
    (effect,) = decision.effects
    assert effect.id == "coulomb"
    assert effect.parameters["friction_N"].value == pytest.approx(FRICTION_N, rel=0.1)


def test_other_motions_count_under_the_whole_error_of_the_reference(reference):
    solution = decided(record(OTHERS, push, seed=2), reference)
    assert not solution.finding.decision.effects
    assert not any(part.matches for part in solution.compared.parts)
    proposal = solution.propose_experiment(None).stated
    assert proposal["kind"] == "repeat of the reference"
    assert proposal["commands"] == [f"{number} repeat 0" for number in range(len(SHAKEN))]


def test_a_matched_difference_has_the_noise_of_both_and_none_of_the_error(reference):
    new = record(SHAKEN, push, seed=2)
    pair = make_pair(new, reference)
    fit = fit_reference(pair, lambda *_: None)
    jacobian = np.zeros((len(new.rows.measured), 2))
    compared = compare_with_reference(make_pair(new, reference), jacobian, fit, ReferenceParts())
    at = nuisance_space().at(fit.mean)
    before = new.rows.measured - new.predicted(at)
    after = compared.rows.measured - compared.predicted(at)
    assert np.sqrt(np.mean((before / new.rows.noise) ** 2)) > 5.0
    assert np.sqrt(np.mean((after / compared.rows.noise) ** 2)) == pytest.approx(1.0, abs=0.2)
    assert compared.rows.noise == pytest.approx(np.sqrt(1.5) * new.rows.noise)


def test_nuisance_parameters_that_both_share_cancel_in_the_difference(reference):
    new = record(SHAKEN, push, seed=2)
    fit = fit_reference(make_pair(new, reference), lambda *_: None)
    jacobian = np.zeros((len(new.rows.measured), 2))
    compared = compare_with_reference(make_pair(new, reference), jacobian, fit, ReferenceParts())
    here = nuisance_space().at(fit.mean)
    there = nuisance_space().at(fit.mean + 0.3)
    change = np.linalg.norm(new.predicted(there) - new.predicted(here))
    left = np.linalg.norm(compared.predicted(there) - compared.predicted(here))
    assert left < 0.1 * change


@pytest.fixture(scope="module")
def rubbing_reference():
    return record(SHAKEN, rub, repeats=2, seed=1)


def test_what_the_model_lacks_in_the_reference_is_no_change_in_other_motions(rubbing_reference):
    solution = decided(record(OTHERS, rub, seed=2), rubbing_reference)
    assert solution.omission == ("coulomb",)
    assert not solution.finding.decision.effects
    assert solution.finding.decision.family is None


def test_a_change_shows_in_other_motions_beside_what_the_model_lacks(rubbing_reference):
    solution = decided(record(OTHERS, rub, seed=2, mass_kg=1.1), rubbing_reference)
    assert solution.omission == ("coulomb",)
    (effect,) = solution.finding.decision.effects
    assert effect.id == "extra_mass"
    assert effect.parameters["mass_kg"].value == pytest.approx(0.1, rel=0.1)


def test_what_the_model_lacks_is_part_of_it_where_commands_are_the_same_too(rubbing_reference):
    """Beside a model without friction the change would have twice its size."""
    solution = decided(record(SHAKEN, lambda v: 2.0 * rub(v), seed=2), rubbing_reference)
    assert solution.omission == ("coulomb",)
    (effect,) = solution.finding.decision.effects
    assert effect.id == "coulomb"
    assert effect.parameters["friction_N"].value == pytest.approx(FRICTION_N, rel=0.1)


def test_nothing_is_looked_for_where_the_model_predicts_the_reference_as_usual(monkeypatch):
    monkeypatch.setattr(problem, "find_omission", Mock(side_effect=AssertionError))
    usual = record(SHAKEN, lambda _: 0.0, repeats=2, seed=1)
    solution = decided(record(SHAKEN, lambda _: 0.0, seed=2), usual)
    assert solution.finding.decision.grade == "nothing missing"


@pytest.mark.parametrize(("share", "is_withheld"), [(0.1, False), (0.4, True)])
def test_an_effect_is_withheld_where_the_reference_asks_for_half_of_what_it_does(
    monkeypatch, share, is_withheld
):
    """As where nothing can be stated about the reference itself."""
    monkeypatch.setattr(problem, "find_omission", lambda *_: None)
    reference = record(SHAKEN, lambda v: share * 2.0 * rub(v), repeats=2, seed=1)
    solution = decided(record(OTHERS, lambda v: 2.0 * rub(v), seed=2), reference)
    decision = solution.finding.decision
    if is_withheld:
        assert solution.shared == ("coulomb",)
        assert decision.grade == "unexplained"
        assert decision.closest.ids == ("coulomb",)
    else:
        assert solution.shared == ()
        assert [effect.id for effect in decision.effects] == ["coulomb"]


def test_an_omission_that_cannot_be_simulated_in_other_motions_is_left_out(
    rubbing_reference, monkeypatch
):
    compare = problem.compare_pair
    omissions = []

    def fail_with_an_omission(pair, *others):
        omissions.append(len(pair.space.names) > len(nuisance_space().names))
        if omissions[-1]:
            raise SimulationFailed("diverges")
        return compare(pair, *others)

    monkeypatch.setattr(problem, "compare_pair", fail_with_an_omission)
    solution = decided(record(OTHERS, rub, seed=2), rubbing_reference)
    assert omissions == [True, False]
    assert solution.omission == ()
    assert not solution.finding.decision.effects


# Both values of the model are off by about ten of these deviations.
TOO_SURE = replace(nuisance_space(), std=np.array([0.0005, 0.005]))
OFF = np.log([60.3 / 60.0, 0.84 / 0.8]) / TOO_SURE.std


def prior_of(solution):
    return solution.finding.search.nothing.fitted.coordinates.space.joint


@pytest.fixture(scope="module")
def exact_reference():
    return record(SHAKEN, lambda _: 0.0, repeats=2, seed=1)


def test_a_reference_is_fitted_beyond_the_bounds_of_credible_values(exact_reference):
    fit = fit_reference(make_pair(exact_reference, exact_reference, TOO_SURE), lambda *_: None)
    # The prior draws them back a little.
    assert fit.fitted.x == pytest.approx(OFF, abs=1.0)
    assert fit.mean == pytest.approx(fit.fitted.x, abs=0.1)


# As above, by about two and a half of them: doubtful, and still credible.
SURE = replace(nuisance_space(), std=np.array([0.002, 0.02]))


@pytest.mark.parametrize(
    ("space", "shaken", "is_wider"),
    [(SURE, SHAKEN, False), (SURE, OTHERS, True), (TOO_SURE, SHAKEN, True)],
    ids=["same motions", "other motions", "beyond what is credible"],
)
def test_values_that_contradict_known_to_are_less_sure_elsewhere(
    exact_reference, space, shaken, is_wider
):
    solution = decided(record(shaken, lambda _: 0.0, seed=2), exact_reference, space=space)
    off = np.log([60.3 / 60.0, 0.84 / 0.8]) / space.std
    contradiction = np.sqrt(np.mean(off**2))
    assert solution.fit.contradiction == pytest.approx(contradiction, rel=0.1)
    widening = prior_of(solution).std / np.sqrt(np.diag(solution.fit.covariance))
    assert widening == pytest.approx(solution.fit.contradiction if is_wider else 1.0)
    assert solution.finding.decision.grade == "nothing missing"


def test_values_near_the_stated_ones_are_as_sure_in_other_motions(exact_reference):
    solution = decided(record(OTHERS, lambda _: 0.0, seed=2), exact_reference)
    assert solution.fit.contradiction == 1.0
    assert prior_of(solution).std == pytest.approx(np.sqrt(np.diag(solution.fit.covariance)))


def test_only_stated_values_can_contradict_known_to(rubbing_reference):
    solution = decided(record(OTHERS, rub, seed=2), rubbing_reference, space=TOO_SURE)
    assert solution.omission == ("coulomb",)
    assert len(solution.fit.mean) == len(OFF) + 1
    stated = solution.fit.mean[: len(OFF)]
    assert solution.fit.contradiction == pytest.approx(np.sqrt(np.mean(stated**2)))


def test_an_explanation_that_fits_poorly_is_not_stated_in_other_motions(
    rubbing_reference, monkeypatch
):
    monkeypatch.setattr(Decision, "fits_poorly", True)
    solution = decided(record(OTHERS, rub, seed=2, mass_kg=1.1), rubbing_reference)
    decision = solution.finding.decision
    assert decision.grade == "unexplained"
    assert not decision.effects
    assert decision.closest.ids == ("extra_mass",)


def relieve(monkeypatch, grade):
    """Has every statement take the place of an implausible value."""
    decide = problem.decide
    monkeypatch.setattr(
        problem,
        "decide",
        lambda found: replace(decide(found), relieved_strain="mass +4.0 off", grade=grade),
    )


@pytest.mark.parametrize("grade", ["mostly", "identified"])
def test_what_only_replaces_an_implausible_value_is_not_stated_in_other_motions(
    rubbing_reference, monkeypatch, grade
):
    """What is identified is not stated for that reason."""
    relieve(monkeypatch, grade)
    solution = decided(record(OTHERS, rub, seed=2, mass_kg=1.1), rubbing_reference)
    decision = solution.finding.decision
    if grade == "identified":
        assert [effect.id for effect in decision.effects] == ["extra_mass"]
    else:
        assert decision.grade == "unexplained"
        assert not decision.effects
        assert decision.closest.ids == ("extra_mass",)


def test_what_replaces_an_implausible_value_is_stated_in_the_same_motions(
    rubbing_reference, monkeypatch
):
    relieve(monkeypatch, "mostly")
    solution = decided(record(SHAKEN, lambda v: 2.0 * rub(v), seed=2), rubbing_reference)
    assert [effect.id for effect in solution.finding.decision.effects] == ["coulomb"]


def test_in_the_same_motions_a_poor_fit_is_graded_as_without_a_reference(
    rubbing_reference, monkeypatch
):
    monkeypatch.setattr(Decision, "fits_poorly", True)
    solution = decided(record(SHAKEN, lambda v: 2.0 * rub(v), seed=2), rubbing_reference)
    assert [effect.id for effect in solution.finding.decision.effects] == ["coulomb"]


@pytest.mark.parametrize("predicts", [False, True])
@pytest.mark.parametrize("is_plausible", [False, True])
def test_only_both_faults_together_are_a_poor_fit(predicts, is_plausible):
    criteria = (
        Criterion(PROBABLE, False, "", ""),
        Criterion(HELD_OUT, predicts, "", ""),
        Criterion(PLAUSIBLE, is_plausible, "", ""),
    )
    decision = Decision("mostly", Mock(), criteria=criteria)
    assert decision.fits_poorly == (not predicts and not is_plausible)
