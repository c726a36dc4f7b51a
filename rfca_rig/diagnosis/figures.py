"""Figures before and after: residuals of the fit and on held-out conditions, and curves to draw."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.observations import rms
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.cross_validation import loo_residuals
from rfca_rig.diagnosis.result import BeforeAfter, SignalOverlay

Floats = NDArray[np.float64]


def compare_residuals(found: ModelSelectionResult, accepted: Hypothesis, experiment: str) -> Mapping[str, BeforeAfter]:
    """Rms residuals of the nominal and of the accepted model, per signal, with the part that noise and scatter explain."""
    measured = found.dataset.rows.measured
    return _by_signal(found, "rms", measured - found.nominal.predicted, measured - accepted.rows, experiment)


def compare_held_out(found: ModelSelectionResult, accepted: Hypothesis, experiment: str) -> Mapping[str, BeforeAfter]:
    """The same on held-out conditions, all unknowns fitted to the others; each hypothesis has its own most probable discrepancy scale."""
    rows = found.dataset.rows
    conditions = sorted({int(c) for c in rows.condition[rows.experiment == experiment]})
    # A single condition cannot be predicted from others.
    if len(conditions) < 2:
        return {}
    linears = [hypothesis.fitted.linear(rows.measured) for hypothesis in (found.nothing, accepted)]
    before, after = (loo_residuals(linear, found.likelihood.level(linear), rows.condition, conditions) for linear in linears)
    return _by_signal(found, "held_out_rms", before, after, experiment)


def _by_signal(found: ModelSelectionResult, name: str, before: Floats, after: Floats, experiment: str) -> dict[str, BeforeAfter]:
    rows = found.dataset.rows
    floor = np.sqrt(rows.noise**2 + (found.scatter.columns**2).sum(axis=1))
    of_signal = {str(signal): (rows.signal == signal) & (rows.experiment == experiment) for signal in np.unique(rows.signal)}
    return {f"{name}_{s}": BeforeAfter(rms(before[h]), rms(after[h]), rms(floor[h])) for s, h in of_signal.items() if h.any()}


def make_overlays(found: ModelSelectionResult, accepted: Hypothesis, experiment: str) -> tuple[SignalOverlay, ...]:
    """Measured means (m,) with both models, condition by condition and signal by signal."""
    rows, nominal = found.dataset.rows, found.nominal.predicted
    places = [(label, np.flatnonzero(rows.label == number)) for number, label in enumerate(rows.labels) if label.experiment == experiment]
    return tuple(
        SignalOverlay(
            label.condition,
            label.signal,
            rows.t_s[here],
            rows.measured[here],
            nominal[here],
            accepted.rows[here],
            phase=rows.phase[here],
        )
        for label, here in places
        if len(here)
    )
