"""Recordings cut into windows, each simulated from the measured state at its beginning.

Every hypothesis may move that start, within its uncertainty, to where the window fits best. So an error of the start does not appear in all
rows of a window as if they were independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.observations import Label, Observations

Floats = NDArray[np.float64]
W = TypeVar("W")

# Windows per condition: with windows of half a second these are stretches of about two seconds.
WINDOWS_OF_CONDITION = 4
TRANSIENT_SHARE = 0.3  # share of the model's error that is not smooth


@dataclass(frozen=True)
class WindowRows:
    """Measured values of one window with s signals in b bins.

    `t_s` (b,) are times in the run; `measured`, `noise`, `scale` and `transient_scale` are (s, b), as in `Observations`. Without a
    `transient_scale`, the errors that differ from bin to bin are TRANSIENT_SHARE times `scale`.
    """

    t_s: Floats
    measured: Floats
    noise: Floats
    scale: Floats
    transient_scale: Floats | None = None


def group_windows(windows: Sequence[W]) -> list[Sequence[W]]:
    """The windows of one run in groups of about WINDOWS_OF_CONDITION, in their order."""
    count = max(1, round(len(windows) / WINDOWS_OF_CONDITION)) if windows else 0
    bounds = np.linspace(0, len(windows), count + 1).round().astype(int)
    return [windows[a:b] for a, b in pairwise(bounds)]


def observe(windows: Sequence[WindowRows], labels: tuple[Label, ...], run: str, smooth_over_s: float) -> Observations:
    """The windows of one condition as rows, signal by signal within window by window.

    Parameters
    ----------
    windows
        The windows.
    labels
        One per signal.
    run
        The condition of the run, whose repeats err alike.
    smooth_over_s
        Over which time the model's error is alike.
    """
    signals = len(labels)
    scale = np.concatenate([w.scale.ravel() for w in windows])
    t_s = np.concatenate([np.tile(w.t_s, signals) for w in windows])
    return Observations(
        measured=np.concatenate([w.measured.ravel() for w in windows]),
        noise=np.concatenate([w.noise.ravel() for w in windows]),
        scale=scale,
        transient_scale=np.concatenate(
            [(TRANSIENT_SHARE * w.scale if w.transient_scale is None else w.transient_scale).ravel() for w in windows]
        ),
        progress=t_s / smooth_over_s,
        t_s=t_s,
        phase=np.full(len(t_s), run),
        label=np.concatenate([np.repeat(np.arange(signals), len(w.t_s)) for w in windows]),
        condition=np.zeros(len(t_s), dtype=np.intp),
        labels=labels,
    )


def start_gain(start_effect: Floats, variance: Floats) -> Floats:
    """Matrix (k, m) that estimates the errors of a window's start from its residual, in standard deviations.

    Parameters
    ----------
    start_effect
        (k, ...) effect of one standard deviation of each value of the start on the m rows.
    variance
        (...) variance of the rows: sensors and usual model error.
    """
    effect = start_effect.reshape(len(start_effect), -1)
    weighted = effect / variance.ravel()
    # Linear Bayesian estimate; the identity is the prior of start errors in standard deviations.
    return np.asarray(np.linalg.solve(weighted @ effect.T + np.eye(len(effect)), weighted), dtype=np.float64)
