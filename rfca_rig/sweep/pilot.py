"""How long a case takes: a few, from all over the sweep, computed for their time alone."""

from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.sweep.cases import CaseRange, case_row
from rfca_rig.sweep.plan import SweepPlan

MOST_S = 1.0
MOST_CASES = 12
SHARD_S = 1.5
BYTES_PER_NUMBER = 8
CSV_BYTES_PER_NUMBER = 20


@dataclass(frozen=True)
class Pace:
    """Seconds of one core per case."""

    seconds_per_case: float

    @property
    def cases_per_shard(self) -> int:
        """So many that a shard takes well above a second."""
        return max(1, round(SHARD_S / self.seconds_per_case))


def measured_pace(plan: SweepPlan, clock: Clock) -> Pace:
    """Of this process. The first case is not counted: it loads what all need."""
    count = min(MOST_CASES, plan.count)
    case_row(plan, 0)
    begun_s, done = clock.now_s(), 0
    while done < count and clock.now_s() - begun_s < MOST_S:
        case_row(plan, ((2 * done + 1) * plan.count) // (2 * count))
        done += 1
    return Pace(max((clock.now_s() - begun_s) / max(done, 1), 1e-6))


def bytes_expected(plan: SweepPlan) -> int:
    """Of sweep.h5 and sweep.csv together, roughly."""
    columns = len(plan.varied) + len(plan.outputs) + 1
    return plan.count * columns * (BYTES_PER_NUMBER + CSV_BYTES_PER_NUMBER)


def whole(plan: SweepPlan) -> CaseRange:
    """All cases."""
    return CaseRange(0, plan.count)
