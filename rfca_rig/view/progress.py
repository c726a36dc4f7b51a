"""How far a plan has come, and how long it will take: planned times are the longest that stages may take, and what they took so far tells
how much of that they need.
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
    """In the page's words."""
    return KINDS[type(stage).__name__]


@dataclass(frozen=True)
class Listed:
    """A stage as the page lists it."""

    label: str
    kind: str
    duration_s: float


def listed(stages: Sequence[Stage]) -> tuple[Listed, ...]:
    return tuple(Listed(stage.label, kind_of(stage), stage.duration_s) for stage in stages)


@dataclass(frozen=True)
class Position:
    """Shares from 0 to 1, and the seconds that are left, None where nothing can tell yet."""

    stage: int
    stage_done: float
    done: float
    eta_s: float | None


class Progress:
    """Follows the plan by a clock on the wall."""

    def __init__(self, stages: Sequence[Listed]) -> None:
        self._stages = stages
        self._took: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))
        self._planned_after_s = _sums_behind([stage.duration_s for stage in stages])
        self._now = -1
        self._began_s = 0.0
        self._over: float | None = None

    def begin(self, number: int, wall_s: float) -> None:
        """A stage begins, and with that the one before has ended; -1 for one that is not in the plan."""
        self._learn(wall_s)
        self._now, self._began_s = number, wall_s

    def _learn(self, wall_s: float) -> None:
        if self._now >= 0:
            stage = self._stages[self._now]
            took_s, planned_s = self._took[stage.kind]
            self._took[stage.kind] = took_s + wall_s - self._began_s, planned_s + stage.duration_s

    def end(self, wall_s: float, is_whole: bool) -> None:
        """The run is over, with all of its plan done or with what was done until then."""
        self._over = 1.0 if is_whole else self.at(wall_s).done
        self.begin(-1, wall_s)

    def at(self, wall_s: float) -> Position:
        if self._now < 0:
            return Position(-1, 0.0, self._over or 0.0, None)
        needs_s = self._needs_s(self._stages[self._now])
        gone_s = wall_s - self._began_s
        stage_done = min(gone_s / needs_s, 1.0) if needs_s > 0.0 else 0.0
        all_s, after_s = self._planned_after_s[0], self._planned_after_s[self._now + 1]
        planned_s = self._stages[self._now].duration_s
        done = 1.0 - (after_s + (1.0 - stage_done) * planned_s) / all_s if all_s else 0.0
        return Position(self._now, round(stage_done, 4), round(done, 4), round(self._left_s(needs_s, gone_s), 1))

    def _left_s(self, needs_s: float, gone_s: float) -> float:
        return max(needs_s - gone_s, 0.0) + sum(self._needs_s(stage) for stage in self._stages[self._now + 1 :])

    def _needs_s(self, stage: Listed) -> float:
        took_s, planned_s = self._took[stage.kind]
        return stage.duration_s * (took_s / planned_s if planned_s > 0.0 else 1.0)


def _sums_behind(durations_s: Sequence[float]) -> list[float]:
    """At each place, of all from there on; one more than there are durations."""
    sums = [0.0]
    for duration_s in reversed(durations_s):
        sums.append(sums[-1] + duration_s)
    return sums[::-1]
