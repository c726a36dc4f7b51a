"""Computes cases: a row of outputs for each, or the reason why there is none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import RigError
from rfca_rig.sweep.computed import CaseResults, OutputMissing
from rfca_rig.sweep.plan import SweepPlan

Floats = NDArray[np.float64]

# Remarks have a fixed width in the shards' files.
LONGEST_REMARK = 200
INTERNAL_ERROR = "mistake in rfca-rig"


@dataclass(frozen=True)
class CaseRange:
    """The cases `first` to `last`, `last` excluded."""

    first: int
    last: int

    def __len__(self) -> int:
        return self.last - self.first


@dataclass(frozen=True)
class CaseRows:
    """`values` (m, outputs), NaN where there is none, and a remark for each case that gives the reason, else ""."""

    values: Floats
    remarks: tuple[str, ...]


def compute(plan: SweepPlan, span: CaseRange) -> CaseRows:
    """The cases of a range, in their order. A failed case gives a row too."""
    rows = [case_row(plan, case) for case in range(span.first, span.last)]
    return CaseRows(np.array([values for values, _ in rows]).reshape(len(span), len(plan.outputs)), tuple(remark for _, remark in rows))


def make_failed_rows(plan: SweepPlan, span: CaseRange, reason: str) -> CaseRows:
    """Rows of cases that could not be computed."""
    return CaseRows(np.full((len(span), len(plan.outputs)), np.nan), (_short(reason),) * len(span))


def case_row(plan: SweepPlan, case: int) -> tuple[list[float], str]:
    """The outputs of one case and its remark. They depend only on the plan and the number of the case."""
    computed = CaseResults(plan.design(case))
    values, reasons = [], []
    for asked in plan.outputs:
        value = float("nan")
        try:
            value = asked.of(computed)
        except (OutputMissing, RigError) as error:
            # The text after the semicolon is advice for the user of a single command.
            reasons.append(str(error).split(";")[0])
        # One case must not end a sweep of a million: it is reported and counted as failed.
        except Exception as error:
            reasons.append(f"{INTERNAL_ERROR}: {type(error).__name__}: {error}")
        else:
            if not np.isfinite(value):
                reasons.append(f"{asked.header} is not finite")
        values.append(value if np.isfinite(value) else float("nan"))
    # One cause may spoil several outputs; it is stated once.
    return values, _short("; ".join(dict.fromkeys(reasons)))


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_REMARK else line[: LONGEST_REMARK - 2] + ".."
