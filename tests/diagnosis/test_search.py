"""The search over hypotheses, on strokes of a simulated leg."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.config import SearchConfig
from rfca_rig.diagnosis.inference import model_selection
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.inference.screening import (
    EffectProbe,
    grid_of,
    grid_points,
    promising_points,
    terms_of,
)
from rfca_rig.diagnosis.leg.simulator import MOVES, make_leg_dataset, nuisances_of, select_tables
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, read_at_rest, recorded

CONDITIONS = [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)]
BRISKLY = MOVES[0]
SOFTLY = MOVES[2]
HEAVY = present("tip_mass", mass_g=50.0)
LEAKING = present("sensor_crosstalk", fz_per_fy=0.2)
SOFT = present("ground_compliance", stiffness_N_per_m1p5=2e4)
CANDIDATES = ("tip_mass", "sensor_crosstalk", "sensor_gain", "ground_compliance")


def search(effects, candidates=CANDIDATES, tables=False, config=SearchConfig()):  # noqa: B008
    rig = replace(RIG, effects=effects)
    parts = flaps_of(recorded(rig, CONDITIONS, with_shaft=False))
    if tables:
        stages = read_at_rest(ModelPoint(rig), SOFTLY, (60.0, 80.0, 100.0, 120.0))
        parts = [*parts, *make_stage_tables(stages, {}, BRISKLY)]
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))
    return search_models(
        make_leg_dataset(parts),
        coordinates,
        [catalogue()[name] for name in candidates],
        lambda *_: None,
        config=config,
    )


@pytest.mark.slow
@pytest.mark.parametrize("effects", [(HEAVY,), (HEAVY, LEAKING)], ids=["one", "two"])
def test_the_effects_that_are_missing_are_the_most_probable_set(effects):
    found = search(effects)
    assert set(found.named[0].ids) == {effect.id for effect in effects}
    assert found.named[0].marginal.log_evidence > found.nothing.marginal.log_evidence + 100.0
    values = {
        e.id: e.values[0][1]
        for e in found.named[0].fitted.coordinates.supposed(found.named[0].fitted.x).rig.effects
    }
    assert all(
        values[effect.id] == pytest.approx(effect.values[0][1], rel=0.15) for effect in effects
    )


@pytest.mark.long
def test_three_effects_are_searched_where_two_leave_too_much():
    found = search((HEAVY, LEAKING, SOFT))
    assert set(found.named[0].ids) == {"tip_mass", "sensor_crosstalk", "ground_compliance"}


def test_without_anything_missing_nothing_leads():
    found = search(())
    assert all(one.log_joint < found.nothing.log_joint for one in found.named)
    assert np.abs(found.nothing.fitted.x).max() < 1.0


def test_an_effect_that_promises_too_little_is_not_fitted():
    assert (
        search(
            (HEAVY,),
            config=SearchConfig(
                worth_a_fit=np.inf, worth_trying_once=np.inf, worth_beside_a_good_fit=np.inf
            ),
        ).named
        == ()
    )


@pytest.mark.slow
def test_the_static_approach_is_learnt_from_what_fits_well():
    found = search((HEAVY,), ("tip_mass",), tables=True)
    assert {table.moves for table in select_tables(found.dataset.parts)} == {SOFTLY}
    assert found.named[0].ids == ("tip_mass",)


def points_of(*names):
    return grid_points(term for name in names for term in terms_of(catalogue()[name]))


def exchange(state, *names):
    around = model_selection._projection(state, state.nominal)
    probes = model_selection._screen(state, state.nominal, around, points_of(*names)).probes
    return model_selection._exchange(state, probes, SearchConfig())


def test_an_effect_is_probed_again_where_it_promised_most():
    probes = [
        EffectProbe(EffectTerm(catalogue()["tip_mass"]), np.array([z]), np.array([gain]))
        for z, gain in ((-1.0, 2.0), (0.0, 3.0), (1.0, 1.0))
    ]
    by_size = SimpleNamespace(gain=lambda signature: (float(signature[0]), 1.0))
    assert [float(z[0]) for _, z in promising_points(by_size, probes, 2)] == [0.0, -1.0]


def test_an_effect_promises_what_it_does_though_nuisance_parameters_are_off():
    """A softer torque curve, the spring 6 % stiffer than stated and the height 0.4 mm off."""
    leg = replace(RIG.leg, k0_Nm_per_rad=1.06 * RIG.leg.k0_Nm_per_rad)
    rig = replace(RIG, leg=leg, effects=(present("stiffness_hardening", k2_per_rad2=3.8),))
    flaps = flaps_of(
        recorded(
            rig, [(height_mm - 0.4, speed) for height_mm, speed in CONDITIONS], with_shaft=False
        )
    )
    parts = [replace(flap, height_m=flap.height_m + 4e-4) for flap in flaps]
    state = model_selection._fit_nominal(
        make_leg_dataset(parts), Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0)), SearchConfig()
    )

    def promise(base, name):
        screen = model_selection._screen(
            state, base, model_selection._projection(state, base), points_of(name)
        )
        return max(screen.projection.gain(probe.signature)[0] for probe in screen.probes)

    names = ("stiffness_hardening", "spring_hysteresis")
    bases = (state.nothing, state.nominal)
    of_true, of_other = ([promise(base, name) for base in bases] for name in names)
    assert of_true[0] > 2.0 * of_other[0]
    assert of_true[1] < 1.2 * of_other[1]


def test_beside_another_fit_only_effects_that_promise_something_are_simulated_again():
    parts = flaps_of(recorded(replace(RIG, effects=(HEAVY,)), CONDITIONS, with_shaft=False))
    config = SearchConfig()
    state = model_selection._fit_nominal(
        make_leg_dataset(parts), Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0)), config
    )
    around = model_selection._projection(state, state.nominal)
    known = model_selection._screen(
        state, state.nominal, around, points_of("tip_mass", "sensor_clock_rate")
    ).probes

    beside = model_selection._projection(state, state.nothing)
    gains = {}
    for name in ("tip_mass", "sensor_clock_rate"):
        probes = [probe for probe in known if probe.choice.effect.id == name]
        gains[name] = max(beside.gain(probe.signature)[0] for probe in probes)

    def kept(promise):
        screen = model_selection._screen_promising(
            state, state.nothing, known, promise / config.worth_a_probe, config
        )
        assert {probe.choice for probe in screen.probes} == {probe.choice for probe in known}
        known_objects = {id(probe) for probe in known}
        return {probe.choice.effect.id for probe in screen.probes if id(probe) in known_objects}

    assert gains["tip_mass"] > 10.0 * gains["sensor_clock_rate"]
    assert kept(0.0) == set()
    assert kept(2.0 * gains["sensor_clock_rate"]) == {"sensor_clock_rate"}
    assert kept(2.0 * gains["tip_mass"]) == {"tip_mass", "sensor_clock_rate"}


DRY = present("hinge_coulomb_friction", torque_Nm=0.08, presliding_deg=0.4)


@pytest.fixture(scope="module")
def looped():
    """Strokes with dry hinges, searched without the dry hinges in the catalogue: a loop of the
    spring stands in their place.
    """
    parts = flaps_of(recorded(replace(RIG, effects=(DRY,)), CONDITIONS, with_shaft=False))
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))
    config = SearchConfig()
    state = model_selection._fit_nominal(make_leg_dataset(parts), coordinates, config)
    (loop,) = terms_of(catalogue()["spring_hysteresis"])
    start = model_selection.FitStart(
        (loop,), np.concatenate([state.nothing.x, grid_of(loop)[0]]), state.nothing.jacobian
    )
    return state.with_fits(
        [state.optimizer.converge(model_selection._fit(state.optimizer, state, start, 5))]
    )


@pytest.mark.slow
def test_an_effect_is_exchanged_for_one_of_its_family_that_explains_more(looped):
    found = exchange(looped, "hinge_coulomb_friction", "tip_mass")
    assert looped.best.ids == ("spring_hysteresis",) and found.best.ids == (
        "hinge_coulomb_friction",
    )
    values = dict(found.best.coordinates.supposed(found.best.x).rig.effects[0].values)
    assert values["torque_Nm"] == pytest.approx(0.08, rel=0.1)
    assert {fit.ids for fit in found.fits} == {
        ("spring_hysteresis",),
        ("hinge_coulomb_friction",),
    }  # a mass at the tip is no relative


@pytest.mark.slow
def test_what_was_exchanged_once_is_not_again(looped):
    once = exchange(looped)
    assert exchange(once, "hinge_coulomb_friction").fits == looped.fits


def test_a_strained_nuisance_gives_way_to_the_effect_that_does_the_same():
    """A rack that stands 4 mm higher than stated, its height known to 0.5 mm."""
    parts = flaps_of(
        recorded(
            replace(RIG, effects=(present("height_offset", offset_mm=4.0),)),
            CONDITIONS,
            with_shaft=False,
        )
    )
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO | {"height_mm": 0.5}, 0.0))
    state = model_selection._fit_nominal(make_leg_dataset(parts), coordinates, SearchConfig())
    found = exchange(state, "height_offset")
    assert found.best.ids == ("height_offset",)
    assert state.nothing.max_nuisance_shift > 2.5 > found.best.max_nuisance_shift


def begun_with(effect, found_as, known_to):
    """The search where so far only a wrong effect has been fitted."""
    parts = flaps_of(recorded(replace(RIG, effects=(effect,)), CONDITIONS, with_shaft=False))
    state = model_selection._fit_nominal(
        make_leg_dataset(parts), Parameterization(nuisances_of(RIG, known_to, 0.0)), SearchConfig()
    )
    (term,) = terms_of(catalogue()[found_as])
    start = model_selection.FitStart(
        (term,), np.concatenate([state.nothing.x, grid_of(term)[0]]), state.nothing.jacobian
    )
    return state.with_fits([model_selection._fit(state.optimizer, state, start, 5)])


def test_an_effect_gives_way_to_one_that_does_the_same_as_a_strained_nuisance(monkeypatch):
    state = begun_with(
        present("height_offset", offset_mm=4.0), "tip_mass", KNOWN_TO | {"height_mm": 0.5}
    )
    monkeypatch.setattr(model_selection, "LARGEST_SET", 1)  # nothing can be added
    monkeypatch.setattr(
        type(state),
        "best",
        property(lambda self: max(self.fits, key=self.optimizer.free_log_evidence)),
    )
    state = replace(state, exchanged=frozenset({frozenset()}))
    assert state.best.ids == ("tip_mass",) and state.best.max_nuisance_shift > 2.5
    assert exchange(state, "height_offset").best.ids == ("height_offset",)


@pytest.mark.slow
def test_a_fit_with_implausible_nuisances_starts_again_at_their_prior_means(monkeypatch):
    state = begun_with(HEAVY, "tip_mass", KNOWN_TO)
    fit = model_selection._fit
    starts = []
    monkeypatch.setattr(
        model_selection,
        "_fit",
        lambda _, here, start, levels: (starts.append(start), fit(_, here, start, levels))[1],
    )
    exchange(state)
    assert not starts
    far = replace(state.best, x=np.concatenate([[3.8], state.best.x[1:]]))
    astray = replace(state, fits=(far,))
    monkeypatch.setattr(type(astray), "best", property(lambda _: far))
    exchange(astray)
    assert [start.x.tolist() for start in starts] == [far.at_prior_means.tolist()]


@pytest.mark.slow
def test_a_set_that_wins_by_its_last_steps_is_compared_with_its_parts_too(monkeypatch):
    """As if, after the parts of the best set had been fitted, two effects turned out better than
    the one that is missing.
    """
    learn = model_selection._infer_history
    nest = model_selection._fit_nested
    nested = []
    pairs = []

    def fit_nested(state):
        nested.append(state.best.ids)
        return nest(state)

    def learn_of_a_pair(state, enough, config):
        state = learn(state, enough, config)
        if nested and not pairs:
            (leak,) = terms_of(catalogue()["sensor_crosstalk"])
            wider = state.best.coordinates.with_terms((*state.best.coordinates.choices, leak))
            pairs.append(
                state.optimizer.at(wider, np.append(state.best.x, 0.1), state.best.jacobian)
            )
            state.optimizer._free[pairs[0]] = np.inf
            state = state.with_fits(pairs)
        return state

    monkeypatch.setattr(model_selection, "_fit_nested", fit_nested)
    monkeypatch.setattr(model_selection, "_infer_history", learn_of_a_pair)
    monkeypatch.setattr(model_selection.GaussNewton, "converge", lambda _, found: found)
    search((HEAVY,), ("tip_mass",))
    assert nested == [("tip_mass",), ("tip_mass", "sensor_crosstalk")]


def test_a_nominal_model_that_cannot_be_simulated_is_said_so(monkeypatch):
    monkeypatch.setattr("rfca_rig.diagnosis.inference.map_fit.GaussNewton.at", lambda *_: None)
    with pytest.raises(SimulationFailed, match="decimal point"):
        search(())


@pytest.mark.parametrize(("evidence", "is_converged"), [(9.0, True), (10.0, False), (12.0, False)])
def test_a_fit_that_is_worse_than_none_is_converged(monkeypatch, evidence, is_converged):
    fit = Mock()
    state = Mock()
    state.coarse.free_log_evidence.return_value = evidence
    monkeypatch.setattr(model_selection, "_fit", lambda *_: fit)
    fitted = model_selection._fit_on_subset(state, Mock(), 10.0)
    assert fitted is (state.coarse.converge.return_value if is_converged else fit)


def test_where_the_model_has_no_answer_nothing_is_converged(monkeypatch):
    monkeypatch.setattr(model_selection, "_fit", lambda *_: None)
    assert model_selection._fit_on_subset(Mock(), Mock(), 10.0) is None
