"""Acceptance tests of a model on measured strokes: signals over time within a band around the
measured ones, and errors of the valley within limits.

The band is that of a comparison with leading and lagging time tolerance. With the measured value
b(t), its tolerance tol(t) = max(absolute, relative |b(t)|), and the window W(t) = [t - lag,
t + lead]:

    lower(t) = min over s in W(t) of b(s) - tol(s)
    upper(t) = max over s in W(t) of b(s) + tol(s)

The simulated signal passes at t where lower(t) <= simulated(t) <= upper(t). A simulated signal that
is the measured one, late by d, has at t the measured value of t - d: it passes where d <= lag. One
that is early by d passes where d <= lead. The simulated value comes from linear interpolation at
the measured times. The window holds recorded samples only, those at its borders included, so that a
time tolerance holds to one sampling period; at the ends of a recording the window is shorter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition, Table2Row
from rfca_rig.analysis.phases import PHASES
from rfca_rig.analysis.repeats import Condition
from rfca_rig.description.tolerances_file import (
    ForceToleranceSection,
    MomentToleranceSection,
    TolerancesFile,
)

Floats = NDArray[np.float64]

# Times are sums of floats: a sample at the very border of a window must not drop out by rounding.
# Far below any sampling period.
TIME_ROUNDING_S = 1e-9


@dataclass(frozen=True)
class SignalTolerance:
    """`absolute` in the unit of the signal, `relative` as a share of the measured magnitude, times
    in s; `phases` are indices into PHASES, None for the whole recording.
    """

    absolute: float
    relative: float = 0.0
    lead_s: float = 0.0
    lag_s: float = 0.0
    phases: tuple[int, ...] | None = None


@dataclass(frozen=True)
class SignalTest:
    """One signal of one measured stroke. `outside` of `samples` are outside the band.

    `t_s`, `measured`, `simulated`, `lower` and `upper` are those of the sample that is farthest
    outside, `beyond` how far it is; of the one nearest to the band's border where none is outside,
    and `beyond` is then 0. `refused` says why there was nothing to compare, "" otherwise.
    """

    source: str
    condition: str
    repeat: int
    signal: str
    samples: int = 0
    outside: int = 0
    t_s: float = np.nan
    measured: float = np.nan
    simulated: float = np.nan
    lower: float = np.nan
    upper: float = np.nan
    beyond: float = np.nan
    refused: str = ""

    @property
    def is_accepted(self) -> bool:
        return not self.outside and not self.refused


@dataclass(frozen=True)
class ValleyTest:
    """One error of one condition in Table II; `error_pct` is None where a valley is missing,
    which is not accepted.
    """

    source: str
    condition: str
    quantity: str
    error_pct: float | None
    limit_pct: float
    refused: str = ""

    @property
    def is_accepted(self) -> bool:
        return self.error_pct is not None and self.error_pct <= self.limit_pct


@dataclass(frozen=True)
class AcceptanceTests:
    """All tests of a report, in the order of its conditions."""

    signals: tuple[SignalTest, ...]
    valleys: tuple[ValleyTest, ...]

    @property
    def count(self) -> int:
        return len(self.signals) + len(self.valleys)

    @property
    def failed(self) -> tuple[SignalTest | ValleyTest, ...]:
        tests: list[SignalTest | ValleyTest] = [*self.valleys, *self.signals]
        return tuple(test for test in tests if not test.is_accepted)


def make_band(t_s: Floats, measured: Floats, tolerance: SignalTolerance) -> tuple[Floats, Floats]:
    """Lower and upper border of the band around a measured signal.

    Parameters
    ----------
    t_s, measured
        Times, ascending, and values of the signal, (m,).
    tolerance
        Tolerances of value and time.

    Returns
    -------
    tuple of arrays
        Lower and upper border, (m,) each.
    """
    tolerances = np.maximum(tolerance.absolute, tolerance.relative * np.abs(measured))
    first = np.searchsorted(t_s, t_s - tolerance.lag_s - TIME_ROUNDING_S, side="left")
    behind = np.searchsorted(t_s, t_s + tolerance.lead_s + TIME_ROUNDING_S, side="right")
    lower = -_window_maxima(tolerances - measured, first, behind)
    return lower, _window_maxima(measured + tolerances, first, behind)


def _window_maxima(values: Floats, first: NDArray[np.intp], behind: NDArray[np.intp]) -> Floats:
    """Largest of values[first[i]:behind[i]] for every i; all are (m,), and no window is empty.

    The maxima of all spans of 1, 2, 4 .. samples are made one from the other. Two spans that
    overlap cover any window, also where samples are missing and windows differ in length.
    """
    lengths = behind - first
    powers = np.frexp(lengths)[1] - 1
    maxima = np.empty(len(values))
    spans = values
    for power in range(int(powers.max(initial=-1)) + 1):
        if power:
            half = 1 << (power - 1)
            spans = np.maximum(spans[:-half], spans[half:])
        of_power = powers == power
        last = behind[of_power] - (1 << power)
        maxima[of_power] = np.maximum(spans[first[of_power]], spans[last])
    return maxima


def run_acceptance_tests(
    compared: Sequence[tuple[str, ComparedCondition]],
    rows: Sequence[Table2Row],
    tolerances: TolerancesFile,
) -> AcceptanceTests:
    """Test every condition of a report.

    Parameters
    ----------
    compared
        Conditions, each with the name of its recording.
    rows
        Their rows of Table II.
    tolerances
        What is tested, and how near the model must be.
    """
    sections = {"fy_N": tolerances.fy, "fz_N": tolerances.fz, "tx_Nm": tolerances.tx}
    signals = [
        test
        for source, condition in compared
        for name, section in sections.items()
        if section is not None
        for test in _test_signal(source, condition, name, _to_tolerance(section))
    ]
    valleys = [test for row in rows for test in _test_valley(row, tolerances)]
    return AcceptanceTests(tuple(signals), tuple(valleys))


def _to_tolerance(section: ForceToleranceSection | MomentToleranceSection) -> SignalTolerance:
    if isinstance(section, ForceToleranceSection):
        absolute = section.absolute_N
    else:
        absolute = section.absolute_Nm
    phases = None
    if section.phases is not None:
        phases = tuple(PHASES.index(phase) for phase in section.phases)
    return SignalTolerance(
        absolute,
        section.relative_pct / 100.0,
        section.lead_ms / 1e3,
        section.lag_ms / 1e3,
        phases,
    )


def _test_signal(
    source: str, compared: ComparedCondition, signal: str, tolerance: SignalTolerance
) -> Iterator[SignalTest]:
    for index, stroke in enumerate(compared.condition.strokes):
        # One simulated stroke serves all repeats, unless each repeat has its own.
        simulated = compared.simulated[index % len(compared.simulated)].stroke
        test = SignalTest(source, compared.condition.label, stroke.repeat, signal)
        trace = stroke.channel(signal)
        if trace is None:
            yield replace(test, refused=f"{signal} was not recorded")
            continue
        t_s, measured = trace
        # Before its grid the model is at rest; after it the force is unknown.
        expected = np.interp(t_s, simulated.t_s, getattr(simulated, signal), right=np.nan)
        is_compared = np.isfinite(expected)
        if tolerance.phases is not None:
            phases = compared.repeats[index].phases.number(t_s)
            is_compared &= np.isin(phases, tolerance.phases)
        yield _test_samples(test, (t_s, measured), expected, is_compared, tolerance)


def _test_samples(
    test: SignalTest,
    trace: tuple[Floats, Floats],
    expected: Floats,
    is_compared: NDArray[np.bool_],
    tolerance: SignalTolerance,
) -> SignalTest:
    """The test with its result: times and measured values of `trace`, and `expected`, are (m,);
    only samples that `is_compared` marks count.
    """
    if not is_compared.any():
        return replace(test, refused="no sample in these phases while the model is simulated")
    t_s, measured = trace
    # From all samples: a window may reach beyond what is compared.
    lower, upper = make_band(t_s, measured, tolerance)
    beyond = np.where(is_compared, np.maximum(lower - expected, expected - upper), -np.inf)
    worst = int(np.argmax(beyond))
    return replace(
        test,
        samples=int(is_compared.sum()),
        outside=int((beyond > 0.0).sum()),
        t_s=float(t_s[worst]),
        measured=float(measured[worst]),
        simulated=float(expected[worst]),
        lower=float(lower[worst]),
        upper=float(upper[worst]),
        beyond=max(float(beyond[worst]), 0.0),
    )


def _test_valley(row: Table2Row, tolerances: TolerancesFile) -> Iterator[ValleyTest]:
    limits = tolerances.valley
    if limits is None:
        return
    label = Condition(row.height_m, row.speed_rad_s, ()).label
    refused = "; ".join(row.refused)
    if limits.time_error_pct is not None:
        yield ValleyTest(
            row.source, label, "time", row.time_error_pct, limits.time_error_pct, refused
        )
    if limits.force_error_pct is not None:
        yield ValleyTest(
            row.source, label, "force", row.force_error_pct, limits.force_error_pct, refused
        )
