"""Where a force enters that nobody listed, and the formula that it follows: on campaigns of the
exam's own engine, and in closed form.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.phases import StrokePhases, Valley
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.leg.prepared import prepare_leg
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset
from rfca_rig.diagnosis.leg.strokes import DynamicCondition, ShaftTurn
from rfca_rig.diagnosis.residual_force.force_inputs import list_force_inputs, nominal_conditions
from rfca_rig.diagnosis.residual_force.free_form import FreeForm, estimate_free_force, state_place
from rfca_rig.diagnosis.residual_force.sparse_law import SERIES, SURE_OF_SIGN_RAD_S, series
from rfca_rig.diagnosis.residual_force.spline_force import (
    AT_REST_S,
    SplineBasis,
    advance_time,
    bump_in_turn,
    simulate_forced_stroke,
    torque,
)
from rfca_rig.exam.cases import NOTHING, ExamDesign, draw_cases
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import GRAVITY_M_S2, PresentEffect
from tests.model.legs import PAPER

SHORT = ExamDesign(
    tuple((height, speed) for height in (195.0, 215.0) for speed in (2.2, 3.0)), 2, ()
)
BUMPS = SplineBasis(0.03, 8)


def told(folder, **concealed):
    """The free form for a campaign that hides this, without a look at the catalogue."""
    (case,) = draw_cases(7, {NOTHING: 1})
    write_campaign(replace(case, design=SHORT, **concealed), folder / "campaign")
    prepared = prepare_leg([read_campaign(folder / "campaign")])
    return estimate_free_force(
        search_models(make_leg_dataset(prepared.flaps), prepared.coordinates, [], lambda *_: None)
    )


def test_bumps_add_up_to_a_force_that_is_there_before_the_start():
    t_s = np.linspace(-0.5, 0.21, 200)
    assert BUMPS.at(t_s).sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("number", [0, 1, 5])
def test_the_law_follows_its_bump_by_its_own_clock(number):
    row = (-0.3, float(BUMPS.centres_s[number]), BUMPS.spacing_s, float(number == 0), 2.0)
    memory = [0.0]
    rest = torque(0.0, 0.0, 1e9, 0.0, 0.0, [0.0], row)[0]
    assert rest == pytest.approx(2.0 * BUMPS.at(np.array([-0.3]))[0, number])
    for _ in range(100):
        t_s = -0.3 + memory[0]
        assert torque(0.0, 0.0, 0.002, 0.0, 0.0, memory, row)[0] == pytest.approx(
            2.0 * BUMPS.at(np.array([t_s + 0.002]))[0, number]
        )
        advance_time(0.0, 0.0, 0.006, 0.0, 0.0, memory, row)
    advance_time(0.0, 0.0, 2.0 * AT_REST_S, 0.0, 0.0, memory, row)
    assert memory[0] == pytest.approx(0.6)


def test_a_turn_with_a_bump_differs_by_the_bump():
    plain = ramp_to_speed(-0.2, 2.5, 0.05, 0.6)
    bent = bump_in_turn(plain, BUMPS, 3, 0.01)
    t_s = np.linspace(0.0, 0.6, 400)
    assert bent.angle_rad(t_s) - plain.angle_rad(t_s) == pytest.approx(
        0.01 * BUMPS.at(t_s)[:, 3], abs=1e-9
    )


def resting_condition():
    t_s = np.arange(-0.1, 0.04, 0.002)
    first = np.arange(0, len(t_s), 10, dtype=np.intp)
    signals = ("fy_N", "fz_N", "tx_Nm")
    nothing = np.zeros((2, 3 * len(first)))
    return DynamicCondition(
        "",
        0.5,
        ShaftTurn(0.01, None),
        t_s,
        first,
        np.full(len(first), 10),
        signals,
        nothing,
        StrokePhases(0.02, 0.03, 0.04),
        dict.fromkeys(signals, 1.0),
        Valley(0.0, 0.0),
    )


def test_the_mount_bears_what_pulls_at_the_tip_of_a_resting_leg():
    (here,) = nominal_conditions([resting_condition()], ModelPoint(PAPER))
    places = {place.id: place for place in list_force_inputs(here.in_hinge.shape[2])}
    at_rest = slice(0, 5)
    down = places["tip_down"].response(here).sum(axis=1).reshape(3, -1)[:, at_rest]
    along = places["tip_along"].response(here).sum(axis=1).reshape(3, -1)[:, at_rest]
    assert down[0] == pytest.approx(0.0, abs=1e-3)
    assert down[1] == pytest.approx(1.0, abs=1e-3)
    assert along[0] == pytest.approx(-1.0, abs=1e-3)
    assert along[1] == pytest.approx(0.0, abs=1e-3)


def test_a_pull_at_the_tip_bends_the_leg_as_a_weight_there_does():
    (here,) = nominal_conditions([resting_condition()], ModelPoint(PAPER))
    place = next(
        place for place in list_force_inputs(here.in_hinge.shape[2]) if place.id == "tip_down"
    )
    grams = 3.0
    heavier = replace(PAPER, effects=(PresentEffect("tip_mass", (("mass_g", grams),)),))
    weigh_models = here.change_to(
        simulate_forced_stroke(here.flap, ModelPoint(heavier), ()), 1e-3 * grams * GRAVITY_M_S2
    ).reshape(3, -1)[2, :5]
    assert place.response(here).sum(axis=1).reshape(3, -1)[2, :5] == pytest.approx(
        weigh_models, rel=5e-3
    )


def test_the_series_is_the_terms_it_is_named_after_and_knows_its_slopes():
    values = np.linspace(0.1, 0.8, len(SERIES))
    angle = -0.3
    rate = 0.4
    sign = np.tanh(rate / SURE_OF_SIGN_RAD_S)
    named = [1.0, angle, abs(angle), angle**3, sign, rate, rate * abs(rate), abs(angle) * sign]
    found = series(angle, rate, 0.0, 0.0, 0.0, (), values)
    assert found[0] == pytest.approx(values @ named)
    ahead = series(angle + 1e-6, rate, 0.0, 0.0, 0.0, (), values)[0]
    beside = series(angle, rate + 1e-6, 0.0, 0.0, 0.0, (), values)[0]
    assert found[1:] == pytest.approx(
        ((ahead - found[0]) * 1e6, (beside - found[0]) * 1e6), rel=1e-4
    )


def ranked(*places, is_located=True):
    """A free form with these places and log evidences, best first."""
    best = places[0][0]
    return FreeForm(best, f"at {best}", (), places, is_located, "")


def test_the_part_is_stated_that_is_clearly_more_probable_than_the_others():
    stated = state_place(ranked(("tip_along", 50.0), ("tip_down", 30.0), ("hinge2", 40.0)))
    assert stated is not None and (stated.id, stated.words) == ("ground", "at tip_along")
    assert 0.8 < stated.probability <= 0.9
    assert state_place(ranked(("tip_along", 50.0), ("hinge2", 49.0))) is None


def test_a_part_with_many_places_is_no_more_probable_for_that():
    """Six hinges as good as one channel."""
    assert state_place(ranked(*((f"hinge{i}", 50.0) for i in range(2, 8)), ("fz_N", 48.5))) is None
    assert (
        state_place(ranked(*((f"hinge{i}", 50.0) for i in range(2, 8)), ("fz_N", 46.0))).id
        == "hinges"
    )


def test_where_no_force_explains_the_misfit_no_part_is_stated():
    assert state_place(ranked(("fz_N", 500.0), ("hinge2", 10.0), is_located=False)) is None


@pytest.mark.long
def test_a_damping_of_the_hinges_that_is_not_looked_for_is_found_there_with_its_law(tmp_path):
    # with 0.05 a law in hinge 2 alone has a log evidence 4 higher than one in all hinges
    found = told(
        tmp_path, effects={"hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.08}}
    )
    assert found.place == "hinges"
    assert "cause is not known" in found.text
    quadratic = {term.term: term for term in found.terms}["rate |rate|"]
    assert quadratic.coefficient == pytest.approx(0.08, rel=0.4)
    assert quadratic.unit == "N m per rad^2/s^2"


@pytest.mark.slow
def test_a_cable_that_drags_at_the_shaft_is_found_there(tmp_path):
    found = told(tmp_path, effects={"shaft_friction": {"torque_Nm": 0.3}})
    assert found.place == "shaft"
    (_, first), (_, second) = found.ranking[:2]
    assert first - second > 3.0
    drag = {term.term: term for term in found.terms}["sign(shaft rate)"]
    assert abs(drag.coefficient) == pytest.approx(0.3, abs=0.1)
