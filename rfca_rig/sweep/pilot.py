"""Time per case, measured on a few cases from all over the sweep."""

from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.sweep.cases import CaseRange, case_row
from rfca_rig.sweep.plan import SweepPlan

# The measurement ends after this time or number of cases, whichever comes first.
MAX_PILOT_S = 1.0
MAX_PILOT_CASES = 12
# Time that one shard should take.
SHARD_S = 1.5
BYTES_PER_NUMBER = 8
# About 17 digits, a sign, a point and a comma.
CSV_BYTES_PER_NUMBER = 20


@dataclass(frozen=True)
class Pace:
    """Seconds per case on one core."""

    seconds_per_case: float

    @property
    def cases_per_shard(self) -> int:
        """Number of cases for which a shard takes well above a second."""
        return max(1, round(SHARD_S / self.seconds_per_case))


def measure_pace(plan: SweepPlan, clock: Clock) -> Pace:
    """Pace of this process. The first case is not counted, because it loads and compiles what all cases need."""
    count = min(MAX_PILOT_CASES, plan.count)
    case_row(plan, 0)
    start_s, done = clock.now_s(), 0
    while done < count and clock.now_s() - start_s < MAX_PILOT_S:
        # Cases are taken at the middle of equal parts: time differs along the axes.
        case_row(plan, ((2 * done + 1) * plan.count) // (2 * count))
        done += 1
    return Pace(max((clock.now_s() - start_s) / max(done, 1), 1e-6))


def estimate_bytes(plan: SweepPlan) -> int:
    """Rough size of sweep.h5 and sweep.csv together, in bytes."""
    columns = len(plan.varied) + len(plan.outputs) + 1
    return plan.count * columns * (BYTES_PER_NUMBER + CSV_BYTES_PER_NUMBER)


def all_cases(plan: SweepPlan) -> CaseRange:
    """All cases."""
    return CaseRange(0, plan.count)
