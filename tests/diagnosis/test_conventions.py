"""How the shaft went from stage to stage, told from the tables themselves."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.conventions import MOVES, held_anyhow, with_likeliest_moves
from rfca_rig.diagnosis.coordinates import Choice, Coordinates
from rfca_rig.diagnosis.evidence import evidence_of
from rfca_rig.diagnosis.nuisances import nuisances_of
from rfca_rig.diagnosis.stages import stage_tables
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, read_at_rest

ANGLES_DEG = (60.0, 80.0, 100.0, 120.0, 118.0)
SOFT = Choice(catalogue()["damaged_hinge"], (("hinge", 3.0),))


@pytest.fixture(scope="module")
def hypothesis():
    """Coordinates of a leg with one soft hinge, and the point where it is so."""
    coordinates = Coordinates(nuisances_of(RIG, KNOWN_TO, 0.0)).with_choices((SOFT,))
    return coordinates, np.append(np.zeros(coordinates.nuisances), 0.3)


def table(moves, coordinates, x):
    return read_at_rest(coordinates.supposed(x), moves, ANGLES_DEG)


@pytest.mark.parametrize("true", MOVES)
def test_the_moves_are_told_around_the_leg_that_was_there(hypothesis, true):
    stages = table(true, *hypothesis)
    supposed = [evidence_of(stage_tables(stages, {}, moves)) for moves in MOVES]
    found = [with_likeliest_moves(evidence, *hypothesis, stopped_as_told=True) for evidence in supposed]
    assert [evidence.tables[0].moves for evidence in found] == [true] * len(MOVES)
    assert found[MOVES.index(true)] is supposed[MOVES.index(true)]


def test_strokes_alone_are_left_as_they_are(hypothesis):
    evidence = evidence_of(stage_tables(table(MOVES[0], *hypothesis), {}, MOVES[0]))
    without = replace(evidence, parts=())
    assert with_likeliest_moves(without, *hypothesis, stopped_as_told=True) is without and held_anyhow(without) is without


def test_before_the_moves_are_known_friction_is_left_open_and_afterwards_it_counts(hypothesis):
    evidence = evidence_of(stage_tables(table(MOVES[0], *hypothesis), {}, MOVES[1]))
    loose = held_anyhow(evidence)
    assert loose.rows.jolt.max() > 0.0 and not evidence.rows.jolt.any()
    known = with_likeliest_moves(loose, *hypothesis, stopped_as_told=True)
    assert not known.rows.jolt.any() and known.tables[0].moves == MOVES[0]
    assert with_likeliest_moves(loose, *hypothesis, stopped_as_told=False).rows.jolt.max() > 0.0
