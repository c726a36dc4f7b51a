"""An interrupted run as it stands on disk: its plan, what of it is done, why and when it stopped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.errors import TRIP, BadInput
from rfca_rig.protocol.plan import Plan
from rfca_rig.protocol.remaining import PlanProgress
from rfca_rig.protocol.written_plan import parse_plan
from rfca_rig.recording import run_folder
from rfca_rig.recording.layout import refuse_links, stage_files
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.recording.outline import outline_of
from rfca_rig.recording.run_text import Ending, events_of, read_ending, read_header
from rfca_rig.suggestions import not_there

RESUMED = "run resumed"
# What the end of an earlier part says that no later part repeats.
CARRIED_ENDING_KEYS = (
    "ended",
    "exit_status",
    "reason",
    "ended_at",
    "lasted_s",
    "worst_loop_gap_ms",
    "sensor_records",
    "standstill",
    "interrupted",
)
NO_REASON_RECORDED = "it ended without a word: a crash, or a power cut"


@dataclass(frozen=True)
class InterruptedRun:
    """A run that may be continued: `header` as it began, the whole `plan`, and `static` with the stages so far and their photos' angles.

    `why` is the last reason to stop. `last_seen` has both clocks of the last event that states them. `ending` is what its end said,
    `resumed` how often it was continued before.
    """

    folder: Path
    header: Recording
    plan: Plan
    done: PlanProgress
    static: tuple[StaticStage, ...]
    why: str
    last_seen: Mapping[str, str | float]
    ending: Mapping[str, str]
    resumed: int

    @property
    def has_tripped(self) -> bool:
        return self.why.startswith(TRIP)

    def seed(self) -> int | None:
        """Seed for a continued twin, from its first seed and the number of continuations; None on a real rig."""
        # Another seed than before, or the noise of the first part would repeat; the same every time, so that runs are
        # reproducible.
        first = self.header.provenance.get("seed")
        return None if first is None else int(np.random.SeedSequence([int(first), self.resumed + 1]).generate_state(1)[0])


def read_interrupted_run(folder: Path) -> InterruptedRun:
    """Reads an interrupted run; its journals are made into stage files first, as `recover` does.

    Raises BadInput where there is no run, where it still goes on or is done, where a file is damaged, or where its stages are not those of
    its plan.
    """
    if not run_folder.is_run(folder):
        message = (
            f"{folder}: holds no run that could go on; rfca-rig runs --ended stopped lists some" if folder.exists() else not_there(folder)
        )
        raise BadInput(message)
    refuse_links(folder)
    header = read_header(folder)
    # A stage in progress becomes a stage file of its own, cut short, and is repeated by the rest of the plan.
    run_folder.close_journals(folder)
    events, outlines = events_of(folder), [outline_of(file) for file in stage_files(folder)]
    why = _why(events)
    if why == "done":
        raise BadInput(f"{folder}: is done; there is nothing left to resume")
    plan = _plan(folder, header)
    strokes = [stroke for part in outlines for stroke in part.strokes]
    ending = read_ending(folder)
    static = run_folder.with_photo_angles(tuple(stage for part in outlines for stage in part.static), ending)
    _check_stages(folder, plan, strokes, static)
    return InterruptedRun(
        folder=folder,
        header=header,
        plan=plan,
        # Cycles are numbered over the whole run, so the largest number counts, not the number of rows.
        done=PlanProgress(len(strokes), len(static), max((part.last_cycle for part in outlines), default=0)),
        static=static,
        why=why,
        last_seen=_last_clocks(events),
        ending=_ending_texts(ending),
        resumed=sum(event["event"] == RESUMED for event in events),
    )


def _plan(folder: Path, header: Recording) -> Plan:
    try:
        return parse_plan(header.title, header.provenance)
    except BadInput as error:
        raise BadInput(f"{folder}: cannot go on: {error}") from None


def _why(events: list[dict[str, Any]]) -> str:
    """The reason of the end, from the events since the run began or was last continued; a trip takes precedence."""
    since = next((place for place in reversed(range(len(events))) if events[place]["event"] == RESUMED), 0)
    reasons = [str(event["why"]) for event in events[since:] if event["event"] in ("motor off", "run ends") and "why" in event]
    # A trip takes precedence: it is the cause of whatever ended the run after it.
    tripped = [why for why in reasons if why.startswith(TRIP)]
    return (tripped or reasons or [NO_REASON_RECORDED])[-1]


def _ending_texts(ending: Ending | None) -> dict[str, str]:
    """What the end said of the part before, without its photos, which are listed again."""
    return {} if ending is None else {name: text for name, text in ending.provenance.items() if name in CARRIED_ENDING_KEYS}


def _last_clocks(events: list[dict[str, Any]]) -> dict[str, str | float]:
    last: dict[str, Any] = next((event for event in reversed(events) if "utc" in event), {})
    return {name: last[name] for name in ("t_s", "utc") if name in last}


def _check_stages(folder: Path, plan: Plan, strokes: Sequence[tuple[float, float, int]], static: Sequence[StaticStage]) -> None:
    flaps = [(flap.height_m, flap.speed_rad_s, flap.repeat) for flap in plan.flaps][: len(strokes)]
    holds = [(hold.height_m, hold.number) for hold in plan.holds][: len(static)]
    # Files hold mm and plans m; see `height_mm` of `recording.strokes` for the exact round trip.
    flapped = [(height_mm / 1e3, *speed_and_repeat) for height_mm, *speed_and_repeat in strokes]
    if flapped != flaps or [(stage.height_m, stage.stage) for stage in static] != holds:
        raise BadInput(f"{folder}: its stage files are not what its plan begins with; type rfca-rig check {folder}")
