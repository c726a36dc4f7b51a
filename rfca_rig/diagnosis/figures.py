"""Figures before and after: residuals of the fit and on held-out conditions, and curves to draw."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Label, Observations, rms
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.cross_validation import loo_residuals
from rfca_rig.diagnosis.result import BeforeAfter, SignalOverlay

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


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


def group_by_recording(rows: Observations, experiment: str = "") -> dict[tuple[str, str], tuple[list[Label], Integers]]:
    """Blocks of rows that are drawn as one curve: those of one signal in one recording, or in a condition that is not part of one.

    Returns
    -------
    dict
        By name of the recording or condition, and signal: the labels of the blocks, and the indices of their rows. Rows of several blocks
        are in order of time.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for number, label in enumerate(rows.labels):
        if experiment in ("", label.experiment):
            groups.setdefault((label.recording or label.condition, label.signal), []).append(number)
    found = {}
    for place, numbers in groups.items():
        here = np.flatnonzero(np.isin(rows.label, numbers))
        if len(numbers) > 1:
            here = here[np.argsort(rows.t_s[here], kind="stable")]
        if here.size:
            found[place] = ([rows.labels[number] for number in numbers], here)
    return found


def make_overlays(found: ModelSelectionResult, accepted: Hypothesis, experiment: str = "") -> tuple[SignalOverlay, ...]:
    """Measured means (m,) with both models, recording by recording and signal by signal; of all experiments without a name of one."""
    rows, nominal = found.dataset.rows, found.nominal.predicted
    return tuple(
        SignalOverlay(
            name,
            signal,
            rows.t_s[here],
            rows.measured[here],
            nominal[here],
            accepted.rows[here],
            np.array([start_s for label in labels for start_s in label.starts_s]),
            rows.phase[here],
            tuple(label.condition for label in labels),
        )
        for (name, signal), (labels, here) in group_by_recording(rows, experiment).items()
    )
