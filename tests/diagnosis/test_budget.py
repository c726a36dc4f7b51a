"""A search that must end early: the best answer so far, and no statement that it cannot support."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget, allow_minutes
from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.inference.hypotheses import EACH_EFFECT, PAIRS, WEIGHING
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.result_builder import build_result, describe
from rfca_rig.diagnosis.simulator import make_dataset
from tests.diagnosis.oscillator import (
    CATALOGUE,
    OscillatorSimulator,
    Shaking,
    nuisance_space,
    recorded,
)

# One simulation of each condition: the nominal model is evaluated once more for the answer.
MOST_BEYOND = 6


class StoppedClock:
    """Stands still until a test moves it."""

    def __init__(self):
        self.time_s = 0.0

    def now_s(self):
        return self.time_s


def rub(v):
    return 0.4 * v / np.hypot(v, 0.012)


def record(mass_kg=1.0):
    shaken = [Shaking(force, rate) for force in (2.0, 4.0) for rate in (4.0, 7.0, 9.0)]
    conditions = [recorded(condition, rub, seed, mass_kg) for seed, condition in enumerate(shaken)]
    return make_dataset(conditions, OscillatorSimulator())


@pytest.fixture(scope="module")
def dataset():
    return record()


def search_until(dataset, stage):
    """The search whose time is up as soon as a stage begins."""
    clock = StoppedClock()

    def note(text, _):
        if text == stage:
            clock.time_s = 100.0

    config = replace(DEFAULT_SEARCH, budget=allow_minutes(clock, 1.0))
    effects = list(CATALOGUE.values())
    coordinates = Parameterization(nuisance_space())
    return search_models(dataset, coordinates, effects, note, config)


def test_a_budget_is_spent_after_its_minutes():
    clock = StoppedClock()
    clock.time_s = 5.0
    budget = allow_minutes(clock, 0.5)
    clock.time_s = 34.9
    assert not budget.is_spent
    clock.time_s = 35.0
    assert budget.is_spent
    assert allow_minutes(clock, None) is UNLIMITED
    assert not TimeBudget().is_spent


def test_a_search_in_time_says_so(dataset):
    found = search_until(dataset, "no such stage")
    assert found.ended_in == ""
    assert decide(found).effects[0].id == "coulomb"


def test_without_time_for_each_effect_none_is_stated(dataset):
    found = search_until(dataset, EACH_EFFECT)
    assert found.ended_in == EACH_EFFECT
    assert found.named == ()
    decision = decide(found)
    assert decision.grade == "unexplained"
    assert decision.effects == ()
    assert describe(decision) == "The time was up before any effect was tried."


@pytest.mark.parametrize("stage", [PAIRS, WEIGHING])
def test_single_effects_are_enough_for_a_statement_with_a_remark(dataset, stage):
    found = search_until(dataset, stage)
    assert found.ended_in == stage
    decision = decide(found)
    assert [effect.id for effect in decision.effects] == ["coulomb"]
    result = build_result("", found, decision, list(CATALOGUE.values()), "shaking")
    (remark,) = result.remarks
    assert remark.startswith(f"the time was up in the stage {stage!r}")


def test_what_short_windows_say_is_not_stated(dataset):
    found = replace(search_until(dataset, "no such stage"), ended_in="short windows")
    decision = decide(found)
    assert decision.grade == "unexplained"
    assert decision.closest.ids == ("coulomb",)
    assert "So far, coulomb explains most" in describe(decision)


class CountedClock:
    """Its time is up after some looks at it, and it counts simulations until then and beyond."""

    def __init__(self, looks):
        self.looks = looks
        self.before = 0
        self.beyond = 0

    def now_s(self):
        self.looks -= 1
        return 0.0 if self.looks > 0 else 100.0

    def count(self):
        if self.looks > 0:
            self.before += 1
        else:
            self.beyond += 1


@pytest.mark.parametrize("looks", range(4, 25, 3))
def test_hardly_anything_is_simulated_once_the_time_is_up(monkeypatch, looks):
    """Friction and a heavier mass, which take a pair of effects."""
    monkeypatch.setenv("RFCA_RIG_THREADS", "1")
    clock = CountedClock(looks)
    budget = TimeBudget(clock, 60.0)

    class Counted(OscillatorSimulator):
        def simulate(self, at, condition):
            clock.count()
            return super().simulate(at, condition)

    heavier = make_dataset(record(mass_kg=1.2).parts, Counted())
    found = search_models(
        heavier,
        Parameterization(nuisance_space()),
        list(CATALOGUE.values()),
        lambda *_: None,
        replace(DEFAULT_SEARCH, budget=budget),
    )
    assert found.ended_in
    assert clock.beyond <= MOST_BEYOND
