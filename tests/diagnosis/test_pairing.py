"""Second effects beside one that fits well: only what is worth much, and from where the first one really stands."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis import pairing
from rfca_rig.diagnosis.data.dataset import make_dataset
from rfca_rig.diagnosis.inference.forward_selection import CLEARLY_NEEDED, ids_of, select_pairs, swap_effects
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.model_selection import SearchState, _with_parts_again
from rfca_rig.diagnosis.inference.nuisances import nuisances_of
from rfca_rig.diagnosis.inference.optimize import relieving_of
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.inference.screening import EffectProbe, probe_effects
from rfca_rig.diagnosis.likelihood.marginal_likelihood import STRAINED
from rfca_rig.diagnosis.likelihood.repeat_scatter import Scatter
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, recorded

CONDITIONS = [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)]
HEAVY, TURNED = present("tip_mass", mass_g=50.0), present("sensor_crosstalk", fz_per_fy=0.09)
RIVALS = [EffectTerm(catalogue()[name]) for name in ("tip_mass", "sensor_crosstalk", "sensor_drift")]
LATE, TILTED = present("clock_offset", offset_s=-0.005), present("gravity_tilt", angle_rad=-0.03)
SLIGHT = [EffectTerm(catalogue()[name]) for name in ("clock_offset", "gravity_tilt", "sensor_drift")]


def search_models(effects, rivals=RIVALS):
    """The descent on such a leg, where nothing missing fits best, the first rival as it was first tried, and all that was tried."""
    evidence = make_dataset(flaps_of(recorded(replace(RIG, effects=effects), CONDITIONS, with_shaft=False)))
    descent = without_scatter(evidence)
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0))
    believed = descent.at(coordinates, np.zeros(coordinates.size))
    base = descent.refine(believed)
    trials = probe_effects(evidence, believed, rivals)
    begun = descent.at(coordinates.with_terms(rivals[:1]), np.append(believed.x, trials[0].z), believed.jacobian)
    return descent, base, begun, trials


@pytest.fixture(scope="module")
def both():
    return search_models((HEAVY, TURNED))


@pytest.fixture(scope="module")
def slight():
    return search_models((LATE, TILTED), SLIGHT)


def test_a_second_effect_that_is_worth_much_is_put_beside_one_that_fits_well(both):
    descent, base, begun, trials = both
    single = descent.converge(descent.refine(begun))
    assert descent.evaluate(single).fits_well(single.coordinates.nuisances)
    (pair,) = select_pairs(descent, base, [single], trials)
    assert ids_of(pair) == ("tip_mass", "sensor_crosstalk")
    assert descent.log_evidence(pair) > descent.log_evidence(single) + CLEARLY_NEEDED


def test_one_that_promises_much_and_turns_out_to_be_worth_little_is_not(both, monkeypatch):
    descent, base, begun, trials = both
    single = descent.converge(descent.refine(begun))
    monkeypatch.setattr(pairing, "CLEARLY_NEEDED", 300.0)
    assert select_pairs(descent, base, [single], trials) == []


def test_one_that_is_worth_little_is_not():
    descent, base, begun, trials = search_models((HEAVY, replace(TURNED, values=(("fz_per_fy", 0.05),))))
    single = descent.converge(descent.refine(begun))
    assert select_pairs(descent, base, [single], trials) == []


def test_a_second_effect_is_sought_where_nothing_missing_would_do_but_the_first_adds_much_to_it(slight):
    descent, base, begun, trials = slight
    assert descent.evaluate(base).fits_well(base.coordinates.nuisances)
    (pair,) = select_pairs(descent, base, [descent.converge(descent.refine(begun))], trials)
    assert ids_of(pair) == ("clock_offset", "gravity_tilt")


def test_none_is_where_nothing_missing_would_do_and_the_first_adds_little(slight, monkeypatch):
    descent, base, begun, trials = slight
    monkeypatch.setattr(pairing, "CLEARLY_NEEDED", 300.0)
    monkeypatch.setattr(pairing, "tried", lambda *_: pytest.fail("a partner was looked for"))
    assert select_pairs(descent, base, [descent.converge(descent.refine(begun))], trials) == []


def test_pairs_are_built_anew_on_an_effect_that_stood_in_a_bad_light(both):
    """The heavier tip was left where it began, and a drift was put beside it: only its part fitted again shows what it lacks."""
    descent, base, begun, trials = both
    drift = descent.at(begun.coordinates.with_terms([RIVALS[0], RIVALS[2]]), np.append(begun.x, 0.0))
    standing = SearchState(
        descent, Scatter({}, np.empty((len(begun.predicted), 0))), base, (begun,), (descent.converge(descent.refine(drift)),)
    )
    found = _with_parts_again(standing, trials)
    assert ("tip_mass", "sensor_crosstalk") in {ids_of(pair) for pair in found.pairs}
    assert ids_of(found.best) == ("tip_mass", "sensor_crosstalk")


HIGH = present("height_offset", offset_mm=1.5)
SUPPOSED = [EffectTerm(catalogue()[name]) for name in ("tip_mass", "sensor_drift", "height_offset")]


def pair_at_its_best(descent, begun, partner):
    wider = descent.at(begun.coordinates.with_terms([RIVALS[0], partner]), np.append(begun.x, 0.0))
    return descent.converge(descent.refine(wider))


@pytest.mark.parametrize("high_mm", [1.5, -1.5])
def test_what_a_strained_value_stands_for_is_put_in_the_place_of_a_partner(high_mm):
    """A drift stands beside the heavier tip, and the rack is where nobody believes it: it is the rack instead of the drift."""
    descent, _, begun, trials = search_models((HEAVY, replace(HIGH, values=(("offset_mm", high_mm),))), SUPPOSED)
    pair = pair_at_its_best(descent, begun, SUPPOSED[1])
    assert pair.farthest > STRAINED
    found = max(swap_effects(descent, pair, trials), key=descent.log_evidence)
    assert ids_of(found) == ("tip_mass", "height_offset")
    assert dict(found.coordinates.supposed(found.x).rig.effects[1].values)["offset_mm"] == pytest.approx(high_mm, abs=0.25)
    assert descent.log_evidence(found) > descent.log_evidence(pair) + 10.0


def test_nothing_is_exchanged_where_nothing_is_strained(both):
    descent, _, begun, trials = both
    pair = pair_at_its_best(descent, begun, RIVALS[1])
    assert pair.farthest < STRAINED
    assert swap_effects(descent, pair, [*trials, *probe_effects(descent.evidence, pair, SUPPOSED[2:])]) == []


@pytest.mark.parametrize("high_mm", [1.5, -1.5])
def test_a_strained_value_calls_for_the_effect_that_does_the_very_same_and_as_large(high_mm):
    descent, _, begun, _ = search_models((replace(HIGH, values=(("offset_mm", high_mm),)),), SUPPOSED)
    strained = descent.converge(descent.refine(begun))
    place = strained.coordinates.space.names.index("height")
    looks = probe_effects(descent.evidence, strained, SUPPOSED[2:])
    alike = EffectProbe(SUPPOSED[1], np.zeros(1), strained.jacobian[:, place] * strained.x[place])
    ((called,),) = relieving_of(descent, strained, [alike, *looks])
    assert called.choice is SUPPOSED[2] and np.sign(called.z[0]) == np.sign(high_mm)
