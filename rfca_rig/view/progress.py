"""Progress of a plan, and the time that it will still take.

Planned times are the longest that stages may take. The stages done so far show which share of that each kind of stage needs.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from rfca_rig.protocol.plan import Stage

KINDS = {
    "Flap": "flap",
    "Hold": "hold",
    "MoveShaft": "move",
    "Rest": "rest",
    "SetHeight": "height",
    "Approach": "approach",
    "Cycles": "cycles",
    "StiffnessCheck": "check",
}


def kind_of(stage: Stage) -> str:
    """Kind of a stage in the words of the page."""
    return KINDS[type(stage).__name__]


@dataclass(frozen=True)
class ListedStage:
    """A stage in the page's list; `duration_s` is the planned one."""

    label: str
    kind: str
    duration_s: float


def list_stages(stages: Sequence[Stage]) -> tuple[ListedStage, ...]:
    return tuple(ListedStage(stage.label, kind_of(stage), stage.duration_s) for stage in stages)


@dataclass(frozen=True)
class Position:
    """Progress as shares from 0 to 1, and the remaining seconds `eta_s`, None between stages; `stage` is -1 then."""

    stage: int
    stage_done: float
    done: float
    eta_s: float | None


class Progress:
    """Follows the plan by wall time: planned durations are times of the rig, and operators take their own time."""

    def __init__(self, stages: Sequence[ListedStage]) -> None:
        self._stages = stages
        self._took: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))
        # For each place the sum of all durations from there on, (n + 1,); the last is 0.
        sums = [0.0]
        for duration_s in reversed([stage.duration_s for stage in stages]):
            sums.append(sums[-1] + duration_s)
        self._planned_from_s = sums[::-1]
        self._now = -1
        self._began_s = 0.0
        self._over: float | None = None

    def begin(self, number: int, wall_s: float) -> None:
        """A stage begins, which ends the one before; `number` is -1 for one that is not in the plan."""
        if self._now >= 0:
            stage = self._stages[self._now]
            took_s, planned_s = self._took[stage.kind]
            self._took[stage.kind] = took_s + wall_s - self._began_s, planned_s + stage.duration_s
        self._now, self._began_s = number, wall_s

    def end(self, wall_s: float, is_whole: bool) -> None:
        """The run is over; `is_whole` where the whole plan was done."""
        self._over = 1.0 if is_whole else self.at(wall_s).done
        self.begin(-1, wall_s)

    def at(self, wall_s: float) -> Position:
        """Progress at a wall time."""
        if self._now < 0:
            return Position(-1, 0.0, self._over or 0.0, None)
        needs_s = self._needs_s(self._stages[self._now])
        elapsed_s = wall_s - self._began_s
        stage_done = min(elapsed_s / needs_s, 1.0) if needs_s > 0.0 else 0.0
        # Progress of the whole plan counts planned times, not estimates: it must never run backwards when an estimate changes.
        all_s, after_s = self._planned_from_s[0], self._planned_from_s[self._now + 1]
        planned_s = self._stages[self._now].duration_s
        done = 1.0 - (after_s + (1.0 - stage_done) * planned_s) / all_s if all_s else 0.0
        remaining_s = max(needs_s - elapsed_s, 0.0) + sum(self._needs_s(stage) for stage in self._stages[self._now + 1 :])
        return Position(self._now, round(stage_done, 4), round(done, 4), round(remaining_s, 1))

    def _needs_s(self, stage: ListedStage) -> float:
        # Stages of one kind take a similar share of their planned time; without experience the planned time counts.
        took_s, planned_s = self._took[stage.kind]
        return stage.duration_s * (took_s / planned_s if planned_s > 0.0 else 1.0)
