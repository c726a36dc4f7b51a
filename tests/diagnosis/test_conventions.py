"""How the shaft went from stage to stage, told from the tables themselves."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.leg.simulator import MOVES, LegSimulator, make_leg_dataset, nuisances_of
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, read_at_rest

ANGLES_DEG = (60.0, 80.0, 100.0, 120.0, 118.0)
SOFT = EffectTerm(catalogue()["damaged_hinge"], (("hinge", 3.0),))


@pytest.fixture(scope="module")
def hypothesis():
    """Coordinates of a leg with one soft hinge, and the point where it is so."""
    coordinates = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.0)).with_terms((SOFT,))
    return coordinates, np.append(np.zeros(coordinates.nuisances), 0.3)


def inferred(dataset, hypothesis, stopped_as_commanded=True):
    coordinates, x = hypothesis
    return dataset.with_parts(
        LegSimulator(stopped_as_commanded).infer_history(dataset.parts, coordinates.supposed, x)
    )


def forgotten(dataset):
    return dataset.with_parts(dataset.simulator.forget_history(dataset.parts))


def table(moves, coordinates, x):
    return read_at_rest(coordinates.supposed(x), moves, ANGLES_DEG)


@pytest.mark.parametrize("true", MOVES)
def test_the_moves_are_told_around_the_leg_that_was_there(hypothesis, true):
    stages = table(true, *hypothesis)
    supposed = [make_leg_dataset(make_stage_tables(stages, {}, moves)) for moves in MOVES]
    found = [inferred(dataset, hypothesis) for dataset in supposed]
    assert [dataset.parts[0].moves for dataset in found] == [true] * len(MOVES)
    assert found[MOVES.index(true)] is supposed[MOVES.index(true)]


def test_strokes_alone_are_left_as_they_are(hypothesis):
    dataset = make_leg_dataset(make_stage_tables(table(MOVES[0], *hypothesis), {}, MOVES[0]))
    without = replace(dataset, parts=())
    assert inferred(without, hypothesis) is without and forgotten(without) is without


def test_before_the_moves_are_known_friction_is_left_open_and_afterwards_it_counts(hypothesis):
    dataset = make_leg_dataset(make_stage_tables(table(MOVES[0], *hypothesis), {}, MOVES[1]))
    unknown = forgotten(dataset)
    assert unknown.rows.transient_scale.max() > 0.0 and not dataset.rows.transient_scale.any()
    known = inferred(unknown, hypothesis)
    assert not known.rows.transient_scale.any() and known.parts[0].moves == MOVES[0]
    assert (
        inferred(unknown, hypothesis, stopped_as_commanded=False).rows.transient_scale.max() > 0.0
    )
