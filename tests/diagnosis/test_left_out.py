"""Conditions that were left out: predicted with their shaft as commanded, by values from the
others.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.phases import find_valley
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.leg import left_out as left_out_module
from rfca_rig.diagnosis.leg.drive_search import list_drive_effects, search_drive
from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.left_out import predict_left_out
from rfca_rig.diagnosis.leg.result import average_valley_errors
from rfca_rig.diagnosis.leg.strokes import ShaftTurn, make_turn
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.result import (
    BeforeAfter,
    ForceMinimum,
    LeftOutCondition,
    LeftOutValley,
)
from rfca_rig.model.effect import MOTOR_SIDE
from rfca_rig.model.stroke import recall_stroke
from rfca_rig.reports.diagnosis.left_out import measure_misfits
from tests.diagnosis.by_hand import (
    NOISE,
    RIG,
    finding_of,
    flaps_of,
    found_among,
    named,
    nothing_missing,
    prepared_of,
    present,
    recorded,
    shafts_of,
)

FOUR = ((215.0, 2.433), (215.0, 3.249), (235.0, 2.478), (235.0, 3.276))
DROOP = present("motor_speed_droop", kp_Nm_s_per_rad=8.0, ki_Nm_per_rad=60.0)


def find_sag():
    """Conditions of a drive that sags, compared along their recorded turn, and the droop that
    their shaft shows.
    """
    strokes = recorded(replace(RIG, effects=(DROOP,)), FOUR)
    flaps = [
        replace(flap, turn=make_turn(condition, True))
        for condition, flap in zip(group_by_condition(strokes), flaps_of(strokes), strict=True)
    ]
    leg = found_among(flaps, [""])
    prepared = prepared_of(flaps, leg, shafts_of(strokes, flaps))
    droop = [e for e in list_drive_effects((MOTOR_SIDE,)) if e.id == "motor_speed_droop"]
    drive = search_drive(prepared, leg, droop, lambda *_: None, DEFAULT_SEARCH)
    forces = DecidedSearch((), leg, nothing_missing(leg))
    return prepared, LegFindings(forces, finding_of(drive, decide(drive)))


@pytest.fixture(scope="module")
def sag():
    return find_sag()


def test_forces_fall_to_the_noise_though_they_fit_along_the_recorded_turn_before(sag):
    prepared, findings = sag
    along_recorded = findings.forces.search.nothing.fitted.predicted
    measured = findings.forces.search.dataset.rows.measured
    assert np.sqrt(np.mean((measured - along_recorded) ** 2)) < 0.1
    left_out = predict_left_out(prepared, findings)
    assert [condition.condition for condition in left_out] == [f.label for f in prepared.flaps]
    for condition in left_out:
        misfit = measure_misfits([condition])["fz_N"]
        assert misfit.before > 2.0
        # The floor is the noise of the measured means; the fit adds its own.
        assert misfit.after < 1.6 * misfit.noise_floor
        assert condition.valley.time_error_pct.before > 2.0
        assert condition.valley.time_error_pct.after < 0.5


def test_rows_and_valley_are_those_of_one_stroke(sag, monkeypatch):
    prepared, findings = sag
    nominal = findings.forces.search.nominal
    point = nominal.coordinates.supposed(nominal.x)
    simulated = []

    def count_stroke(request, only_sensed):
        simulated.append(request)
        return recall_stroke(request, only_sensed)

    monkeypatch.setattr(left_out_module, "recall_stroke", count_stroke)
    left_out = predict_left_out(prepared, findings)
    assert len(simulated) == 2 * len(prepared.flaps)
    monkeypatch.undo()
    for flap, condition in zip(prepared.flaps, left_out, strict=True):
        turn = ShaftTurn(flap.turn.speed_rad_s, flap.turn.start_rad)
        commanded = replace(flap, turn=turn)
        rows = np.concatenate([overlay.before for overlay in condition.overlays])
        # To the last bit the rows of a stroke that ends with them.
        assert np.array_equal(rows, commanded.simulated(point))
        whole = replace(commanded, t_s=np.arange(0.0, 1.3 * flap.phases.valley_s, 5e-4))
        stroke = whole.stroke(point)
        valley = find_valley(stroke.t_s, stroke.fz_N)
        assert condition.valley.before == ForceMinimum(valley.time_s, valley.fz_N)


def test_values_come_from_the_other_conditions_alone(sag):
    """What a condition was measured at changes all predictions but its own."""
    prepared, findings = sag
    forces = findings.forces
    rows = forces.search.dataset.rows
    first = rows.condition == 0
    shifted = replace(rows, measured=rows.measured + np.where(first, 0.05 * rows.scale, 0.0))
    search = replace(forces.search, dataset=replace(forces.search.dataset, rows=shifted))
    # One level for both, which else depends on all rows.
    level = forces.search.likelihood.usual
    likelihood = replace(forces.search.likelihood, named=(level,), unknown=(level, level))
    as_measured = replace(
        findings, forces=replace(forces, search=replace(forces.search, likelihood=likelihood))
    )
    moved = replace(findings, forces=replace(forces, search=replace(search, likelihood=likelihood)))
    before = predict_left_out(prepared, as_measured)
    after = predict_left_out(prepared, moved)
    changes = [
        float(np.abs(a.overlays[1].after - b.overlays[1].after).max())
        for a, b in zip(after, before, strict=True)
    ]
    assert changes[0] < 0.01 * min(changes[1:])


def test_an_effect_of_the_leg_is_in_the_model_after():
    tip = present("tip_mass", mass_g=6.0)
    flaps = flaps_of(recorded(replace(RIG, effects=(tip,)), FOUR))
    leg = found_among(flaps, ["tip_mass"])
    forces = DecidedSearch((), leg, replace(named(leg), explanation=leg.named[0]))
    left_out = predict_left_out(prepared_of(flaps, leg), LegFindings(forces))
    misfit = measure_misfits(left_out)["fz_N"]
    assert misfit.after < 0.5 * misfit.before
    # One recorded stroke for each condition: the floor is its noise.
    overlay = left_out[0].overlays[1]
    assert np.median(overlay.floor) == pytest.approx(NOISE["fz_N"] / np.sqrt(20.0), rel=0.2)


def test_the_floor_is_the_scatter_of_the_mean_over_repeats():
    flaps = flaps_of(recorded(RIG, FOUR))
    twice = [replace(f, repeats=f.repeats + np.array([[-0.3], [0.3]])) for f in flaps]
    leg = found_among(twice, [""])
    forces = DecidedSearch((), leg, nothing_missing(leg))
    left_out = predict_left_out(prepared_of(twice, leg), LegFindings(forces))
    for overlay in left_out[0].overlays:
        assert overlay.floor == pytest.approx(0.3)


def test_errors_of_valleys_are_averaged_over_conditions_that_have_them():
    measured = ForceMinimum(1.0, -50.0)
    of_row = LeftOutValley(measured, ForceMinimum(1.04, -51.0), ForceMinimum(0.99, -50.0))
    rows = (
        LeftOutCondition("a", (), of_row),
        LeftOutCondition("b", (), None),
        LeftOutCondition("c", (), replace(of_row, before=ForceMinimum(0.98, -50.0))),
    )
    errors = average_valley_errors(rows)
    assert errors["valley_time_error_pct"] == BeforeAfter(pytest.approx(3.0), pytest.approx(1.0))
    assert errors["valley_force_error_pct"] == BeforeAfter(pytest.approx(1.0), pytest.approx(0.0))
    assert average_valley_errors(rows[1:2]) == {}
