"""Fits along strokes that grow: to what descents on whole strokes do not reach, and no stop is lost on the way."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.inference import continuation as growing
from rfca_rig.diagnosis.inference.continuation import continue_from_beginnings
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.leg.nuisances import nuisances_of
from rfca_rig.diagnosis.leg.simulator import leg_dataset
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, recorded

CONDITIONS = [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)]
STOPPED = present("hinge_stop", angle_deg=22.0, stiffness_Nm_per_rad=16.0)
TRUE, FAR, SOFT = (0.45, -1.27), (0.6, 1.0), (-0.5, -2.0)  # coordinates of the stop's angle and stiffness


@pytest.fixture(scope="module")
def descent():
    evidence = leg_dataset(flaps_of(recorded(replace(RIG, effects=(STOPPED,)), CONDITIONS, with_shaft=False)))
    return without_scatter(evidence)


@pytest.fixture(scope="module")
def begun(descent):
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0)).with_terms([EffectTerm(catalogue()["hinge_stop"])])
    return lambda stop, nuisances=0.0: descent.at(coordinates, np.concatenate([np.full(coordinates.nuisances, nuisances), stop, [0.0]]))


def stop_of(fitted):
    return dict(fitted.coordinates.supposed(fitted.x).rig.effects[0].values)


def is_true(fitted):
    return stop_of(fitted) == {
        "angle_deg": pytest.approx(22.0, abs=0.1),
        "stiffness_Nm_per_rad": pytest.approx(16.0, rel=0.15),
        "exponent": pytest.approx(1.0, abs=0.15),
    }


def test_a_stop_is_found_behind_a_wall_that_whole_strokes_do_not_pass(descent, begun):
    straight = descent.converge(descent.refine(begun(FAR)))
    (found,) = continue_from_beginnings(descent, [begun(FAR)])
    assert not is_true(straight) and is_true(found)
    assert descent.log_evidence(found) > descent.log_evidence(straight) + 100.0


def test_nuisances_begin_as_believed(descent, begun):
    near, far = (continue_from_beginnings(descent, [begun(FAR, nuisances)])[0] for nuisances in (0.0, 2.0))
    assert np.array_equal(near.x, far.x)


def test_a_stop_that_the_beginnings_do_not_reach_stays_where_it_was(descent, begun, monkeypatch):
    assert is_true(continue_from_beginnings(descent, [begun(TRUE)])[0])
    monkeypatch.setattr(growing, "UNSEEN", np.inf)
    assert not is_true(continue_from_beginnings(descent, [begun(TRUE)])[0])


def test_the_best_go_on(descent, begun, monkeypatch):
    monkeypatch.setattr(growing, "KEPT", 1)
    (found,) = continue_from_beginnings(descent, [begun(SOFT), begun(TRUE), begun(SOFT)])
    assert is_true(found)


def test_nothing_grows_without_strokes(descent, begun):
    assert continue_from_beginnings(replace(descent, evidence=replace(descent.evidence, parts=())), [begun(TRUE)]) == []


def test_strokes_end_where_they_have_grown_to(descent):
    for flap, whole in zip(descent.evidence.truncated(0.6).parts, descent.evidence.parts, strict=True):
        end_s = whole.phases.touchdown_s + 0.6 * (whole.phases.valley_s - whole.phases.touchdown_s)
        assert flap.t_s[-1] == pytest.approx(end_s, abs=0.03) and flap.t_s[-1] < whole.t_s[-1]
