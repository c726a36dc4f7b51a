"""fz of a condition over time as CSV: what the figures of its strokes show."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.matched_simulation import MatchedSimulation
from rfca_rig.escaping import csv_line

Floats = NDArray[np.float64]

# Width of the bins over which samples of a sensor are averaged. The model is sampled in their
# middle.
BIN_S = 1e-3


def trace_csv(
    compared: ComparedCondition, further: Mapping[str, MatchedSimulation] | None = None
) -> str:
    """A row for every millisecond from the start of the motion to the end of the longest recording.

    Parameters
    ----------
    compared
        Gives a column for each repeat, `measured_1_fz_N`, and for each simulated stroke,
        `simulated_1_fz_N`.
    further
        More simulated strokes by the names of their columns.

    Returns
    -------
    str
        CSV with empty cells where a trace has ended, or has no sample in a bin.
    """
    ends_s = [float(repeat.t_s[-1]) for repeat in compared.repeats if len(repeat.t_s)]
    if not ends_s:
        ends_s = [float(model.stroke.t_s[-1]) for model in compared.simulated]
    # Whole milliseconds are in the middle of a bin, where the samples of a sensor with 1 kHz are.
    middles_s = BIN_S * np.arange(int(max(ends_s) / BIN_S) + 1, dtype=np.float64)
    edges_s = np.append(middles_s - 0.5 * BIN_S, middles_s[-1] + 0.5 * BIN_S)
    columns = {"t_s": middles_s}
    for repeat in compared.repeats:
        means = _average_in_bins(repeat.t_s, repeat.fz_N, edges_s)
        columns[f"measured_{repeat.repeat}_fz_N"] = means
    simulated = {
        f"simulated_{number}_fz_N": model
        for number, model in enumerate(compared.simulated, start=1)
    }
    for name, model in {**simulated, **(further or {})}.items():
        # Unknown after the end of the simulation.
        columns[name] = np.interp(middles_s, model.stroke.t_s, model.stroke.fz_N, right=np.nan)
    lines = [csv_line(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(csv_line(f"{value:.6g}" if np.isfinite(value) else "" for value in row))
    return "".join(lines)


def _average_in_bins(t_s: Floats, values: Floats, edges_s: Floats) -> Floats:
    """Mean (m,) of the samples in each bin between `edges_s` (m + 1,), NaN where there is none."""
    sums, _ = np.histogram(t_s, edges_s, weights=values)
    counts, _ = np.histogram(t_s, edges_s)
    means = np.full(len(counts), np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means
