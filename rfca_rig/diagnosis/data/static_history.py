"""What nobody wrote down of a static table and the table itself tells: how the shaft went from stage to stage."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import Dataset, make_dataset
from rfca_rig.diagnosis.data.stages import HOLD_S, StageTable
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.covariance import discrepancy, factored
from rfca_rig.diagnosis.likelihood.laplace import Linear, laplace_posterior
from rfca_rig.model.static_stages import StageMoves

Floats = NDArray[np.float64]

MOVES = (StageMoves(1.0, 0.005, HOLD_S), StageMoves(1.0, 0.05, HOLD_S), StageMoves(0.2, 0.2, HOLD_S))
MODEL_ERROR = 0.01
STEP = 0.3


def infer_approach(tables: Sequence[StageTable], coordinates: Parameterization, x: Floats) -> StageMoves:
    """Of the usual ways the one with the greatest evidence, all unknowns free around x."""
    return max(MOVES, key=lambda moves: _log_evidence([replace(table, moves=moves) for table in tables], coordinates, x))


def with_free_friction(evidence: Dataset) -> Dataset:
    """The evidence before anything is known of how the shaft was moved: what friction held at a static stage is left open."""
    return _with_tables(evidence, [replace(table, stopped_as_told=False) for table in evidence.tables])


def with_inferred_approach(evidence: Dataset, coordinates: Parameterization, x: Floats, stopped_as_told: bool) -> Dataset:
    """The evidence, its static tables moved through as is likeliest around x; the very same where that is how they are already."""
    if not evidence.tables:
        return evidence
    tables = [replace(table, stopped_as_told=stopped_as_told) for table in evidence.tables]
    moves = infer_approach(tables, coordinates, x)
    return _with_tables(evidence, [replace(table, moves=moves) for table in tables])


def _with_tables(evidence: Dataset, tables: Sequence[StageTable]) -> Dataset:
    if tuple(tables) == evidence.tables:
        return evidence
    return make_dataset([part for part in evidence.parts if not isinstance(part, StageTable)] + list(tables))


def _log_evidence(tables: Sequence[StageTable], coordinates: Parameterization, x: Floats) -> float:
    evidence = make_dataset(tables)
    rows = evidence.rows
    here, *moved = evidence.predicted_all([coordinates.supposed(point) for point in (x, *(x + STEP * unit for unit in np.eye(len(x))))])
    if here is None:
        return -np.inf
    jacobian = np.column_stack([np.zeros(len(here)) if m is None else (m - here) / STEP for m in moved])
    whitening = factored(np.diag(rows.noise**2) + MODEL_ERROR**2 * discrepancy(rows))
    return laplace_posterior(Linear(rows.measured - here + jacobian @ x, jacobian), whitening).log_evidence
