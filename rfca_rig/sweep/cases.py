"""Computes cases: a row of outputs each, or why there is none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import RigError
from rfca_rig.sweep.computed import Computed, Missing
from rfca_rig.sweep.plan import SweepPlan

Floats = NDArray[np.float64]

LONGEST_REMARK = 200
MISTAKE = "mistake in rfca-rig"


@dataclass(frozen=True)
class CaseRange:
    """The cases `first` to `last`, `last` excluded."""

    first: int
    last: int

    def __len__(self) -> int:
        return self.last - self.first


@dataclass(frozen=True)
class Rows:
    """`values` (m, outputs), NaN where there is none, and for each case a remark that says why, else ""."""

    values: Floats
    remarks: tuple[str, ...]


def compute(plan: SweepPlan, span: CaseRange) -> Rows:
    """The cases of a span, in their order. A case that fails is a row too."""
    rows = [case_row(plan, case) for case in range(span.first, span.last)]
    return Rows(np.array([values for values, _ in rows]).reshape(len(span), len(plan.outputs)), tuple(remark for _, remark in rows))


def failed(plan: SweepPlan, span: CaseRange, reason: str) -> Rows:
    """Rows of cases that nobody could compute."""
    return Rows(np.full((len(span), len(plan.outputs)), np.nan), (_short(reason),) * len(span))


def case_row(plan: SweepPlan, case: int) -> tuple[list[float], str]:
    """The outputs of one case and its remark. It depends on nothing but the plan and the number."""
    computed = Computed(plan.design(case))
    values, reasons = [], []
    for asked in plan.outputs:
        value = float("nan")
        try:
            value = asked.of(computed)
        except (Missing, RigError) as error:
            reasons.append(str(error).split(";")[0])
        except Exception as error:  # one case must not end a sweep of a million: it is told, and counted as failed
            reasons.append(f"{MISTAKE}: {type(error).__name__}: {error}")
        else:
            if not np.isfinite(value):
                reasons.append(f"{asked.header} is not finite")
        values.append(value if np.isfinite(value) else float("nan"))
    return values, _short("; ".join(dict.fromkeys(reasons)))


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_REMARK else line[: LONGEST_REMARK - 2] + ".."
