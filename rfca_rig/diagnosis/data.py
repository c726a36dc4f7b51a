"""Recordings as one vector of observations: means over short bins and over repeats, of every
signal; and recordings cut into windows.

Bins are short enough to resolve the motion, for example 10 to 25 ms in a stroke. Each value is the
mean over the samples of a bin and over the repeats. Readings of static stages follow as they were
recorded.

Each window is simulated from the measured state at its beginning. Every hypothesis may move that
start, within its uncertainty, to where the window fits best. So an error of the start does not
appear in all rows of a window as if they were independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Label:
    """What a block of rows belongs to, and how the model errs in them.

    Parameters
    ----------
    experiment
        The kind of experiment, as in "dynamic" or "static".
    condition
        In words, as in "215 mm, 2.433 rad/s" or "215 mm".
    signal
        Its name, which ends with its unit.
    correlation_length
        How far the rows' `progress` differs where the model's errors are no longer alike.
    errs_by_phase
        Whether the model errs independently in each phase.
    recording
        The recording that the condition is a part of, in words; "" where it is not one of several
        parts.
    starts_s
        Times in the recording at which its windows start.
    """

    experiment: str
    condition: str
    signal: str
    correlation_length: float = 1.0
    errs_by_phase: bool = True
    recording: str = ""
    starts_s: tuple[float, ...] = ()


@dataclass(frozen=True)
class Observations:
    """All observations of a dataset. Every array is (m,), one entry per row.

    Parameters
    ----------
    measured
        In the unit of the signal.
    noise
        Standard deviation from the sensor alone, in that unit.
    scale
        Size of the signal that a relative model error refers to: 1 % of it is the effect of a
        generalised force that is wrong by 1 %.
    transient_scale
        Size of a model error that is independent from row to row; it is multiplied by the
        discrepancy scale like `scale`.
    progress
        Position along the condition over which the model error is smooth, in the unit of the
        label's `correlation_length`.
    t_s
        Time; for static stages the shaft angle in rad.
    phase
        Phase in words.
    label
        Index into `labels`.
    condition
        Number of the condition.
    labels
        What the blocks of rows belong to.
    """

    measured: Floats
    noise: Floats
    scale: Floats
    transient_scale: Floats
    progress: Floats
    t_s: Floats
    phase: NDArray[np.str_]
    label: Integers
    condition: Integers
    labels: tuple[Label, ...]

    @property
    def signal(self) -> NDArray[np.str_]:
        """Name of the signal of each row."""
        return np.array([label.signal for label in self.labels])[self.label]

    @property
    def experiment(self) -> NDArray[np.str_]:
        """The kind of experiment of each row."""
        return np.array([label.experiment for label in self.labels])[self.label]

    @property
    def recording(self) -> Integers:
        """Number of the recording of each row; a condition that is no part of one counts as a
        recording.
        """
        names = np.array(
            [label.recording or f"{label.experiment}, {label.condition}" for label in self.labels]
        )[self.label]
        return np.unique(names, return_inverse=True)[1].astype(np.intp)

    def names(self) -> tuple[str, ...]:
        """The conditions in words, in the order in which `condition` counts them."""
        names: dict[int, str] = {}
        for label, condition in zip(self.label, self.condition, strict=True):
            names.setdefault(
                int(condition), f"{self.labels[label].experiment}, {self.labels[label].condition}"
            )
        return tuple(names[number] for number in sorted(names))

    def take(self, rows: Integers) -> "Observations":
        """The rows of these numbers (k,), in their order; labels and condition numbers stay."""
        columns = {name: getattr(self, name)[rows] for name in (*_PLAIN, "label", "condition")}
        return Observations(**columns, labels=self.labels)


def stack_observations(parts: list[Observations]) -> Observations:
    """The observations of several conditions as one; their condition numbers and label indices
    are shifted to stay unique.
    """
    labels: list[Label] = []
    label = []
    condition = []
    conditions = 0
    for part in parts:
        label.append(part.label + len(labels))
        condition.append(part.condition + conditions)
        labels += part.labels
        conditions += int(part.condition.max()) + 1
    columns = {}
    for name in _PLAIN:
        columns[name] = np.concatenate([getattr(part, name) for part in parts])
    return Observations(
        **columns,
        label=np.concatenate(label),
        condition=np.concatenate(condition),
        labels=tuple(labels),
    )


# Columns that are only concatenated; `label` and `condition` need an offset.
_PLAIN = ("measured", "noise", "scale", "transient_scale", "progress", "t_s", "phase")


def rms(values: Floats) -> float:
    """Root mean square of values (m,), in their unit."""
    return float(np.sqrt(np.mean(values**2)))


W = TypeVar("W")

# length of a condition of several windows: a stretch that errs as a whole, and one of several in
# most recordings
CONDITION_S = 2.0
WINDOWS_OF_CONDITION = 4  # at most, so that short recordings have several conditions
TRANSIENT_SHARE = 0.3  # share of the model's error that is not smooth


@dataclass(frozen=True)
class WindowRows:
    """Measured values of one window with s signals in b bins.

    `t_s` (b,) are times in the run; `measured`, `noise`, `scale` and `transient_scale` are (s, b),
    as in `Observations`. Without a `transient_scale`, the errors that differ from bin to bin are
    TRANSIENT_SHARE times `scale`.
    """

    t_s: Floats
    measured: Floats
    noise: Floats
    scale: Floats
    transient_scale: Floats | None = None


def group_windows(windows: Sequence[W], length_s: float) -> list[Sequence[W]]:
    """The windows of one run in groups of about CONDITION_S, in their order; `length_s` is the
    length of a window.
    """
    if not windows:
        return []
    of_condition = min(max(round(CONDITION_S / length_s), 1), WINDOWS_OF_CONDITION)
    count = max(1, round(len(windows) / of_condition))
    bounds = np.linspace(0, len(windows), count + 1).round().astype(int)
    return [windows[a:b] for a, b in pairwise(bounds)]


def observe(
    windows: Sequence[WindowRows], labels: tuple[Label, ...], run: str, smooth_over_s: float
) -> Observations:
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
            [
                (
                    TRANSIENT_SHARE * w.scale if w.transient_scale is None else w.transient_scale
                ).ravel()
                for w in windows
            ]
        ),
        progress=t_s / smooth_over_s,
        t_s=t_s,
        phase=np.full(len(t_s), run),
        label=np.concatenate([np.repeat(np.arange(signals), len(w.t_s)) for w in windows]),
        condition=np.zeros(len(t_s), dtype=np.intp),
        labels=labels,
    )


def start_gain(start_effect: Floats, variance: Floats) -> Floats:
    """Matrix (k, m) that estimates the errors of a window's start from its residual, in standard
    deviations.

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
    return np.asarray(
        np.linalg.solve(weighted @ effect.T + np.eye(len(effect)), weighted), dtype=np.float64
    )


UNITS = {
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_Nm": "N m",
    "_N": "N",
    "_deg": "deg",
    "_rad": "rad",
    "_m": "m",
}


def unit_of(signal: str) -> str:
    """The unit that ends the name of a signal, in the usual notation; empty where there is none."""
    return next((unit for ending, unit in UNITS.items() if signal.endswith(ending)), "")
