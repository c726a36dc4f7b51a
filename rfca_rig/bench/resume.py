"""Continues an interrupted run in its own folder: as it stands on disk, and both parts joined.

`rig_compatibility` compares the present rig, camera, devices and software with those of the run.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.bench.stage_photos import photo_hashes, read_stage_photos
from rfca_rig.clock import Clock
from rfca_rig.errors import TRIP, BadInput
from rfca_rig.protocol.plan import Plan
from rfca_rig.protocol.written_plan import PlanProgress, parse_plan
from rfca_rig.recording import run_folder
from rfca_rig.recording.layout import refuse_links, stage_files
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.recording.run_text import Ending, events_of, read_ending, read_header
from rfca_rig.recording.store import outline_of
from rfca_rig.suggestions import not_there
from rfca_rig.vision.leg_photo import PhotoSetup

RESUMED = "run resumed"
# What the end of an earlier part says that no later part repeats.
CARRIED_ENDING_KEYS = (
    "ended",
    "exit_status",
    "reason",
    "ended_at",
    "lasted_s",
    "worst_loop_gap_ms",
    "loop_gaps_ms",
    "sensor_records",
    "standstill",
    "interrupted",
)
# Keys of what devices report of themselves.
DEVICE_PREFIXES = ("motor_", "sensor_", "camera")
NO_REASON_RECORDED = "it ended without a word: a crash, or a power cut"


@dataclass(frozen=True)
class InterruptedRun:
    """A run that may be continued: `header` as it began, the whole `plan`, and `static` with the
    stages so far and their photos' angles.

    `why` is the last reason to stop. `last_seen` has both clocks of the last event that states
    them. `ending` is what its end states, `resumed` how often it was continued before. `devices` is
    what the devices of its last part reported of themselves.
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
    devices: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_tripped(self) -> bool:
        return self.why.startswith(TRIP)

    def seed(self) -> int | None:
        """Seed for a continued twin, from its first seed and the number of continuations; None
        on a real rig.
        """
        # Another seed than before, or the noise of the first part would repeat; the same every
        # time, so that runs are reproducible.
        first = self.header.provenance.get("seed")
        if first is None:
            return None
        return int(np.random.SeedSequence([int(first), self.resumed + 1]).generate_state(1)[0])


def read_interrupted_run(folder: Path) -> InterruptedRun:
    """Reads an interrupted run; its journals are made into stage files first, as `recover` does.

    Raises BadInput where there is no run, where it still goes on or is done, where a file is
    damaged, or where its stages are not those of its plan.
    """
    if not run_folder.is_run(folder):
        if folder.exists():
            message = (
                f"{folder}: holds no run that could go on; rfca-rig runs --ended stopped lists some"
            )
        else:
            message = not_there(folder)
        raise BadInput(message)
    refuse_links(folder)
    header = read_header(folder)
    # A stage in progress becomes a stage file of its own, cut short, and is repeated by the rest of
    # the plan.
    run_folder.close_journals(folder)
    events = events_of(folder)
    outlines = [outline_of(file) for file in stage_files(folder)]
    why = _why(events)
    if why == "done":
        raise BadInput(f"{folder}: is done; there is nothing left to resume")
    plan = _plan(folder, header)
    strokes = [stroke for part in outlines for stroke in part.strokes]
    ending = read_ending(folder)
    static = run_folder.with_photo_angles(
        tuple(stage for part in outlines for stage in part.static), ending
    )
    flaps = [(flap.height_m, flap.speed_rad_s, flap.repeat) for flap in plan.flaps][: len(strokes)]
    holds = [(hold.height_m, hold.number) for hold in plan.holds][: len(static)]
    # Files hold mm and plans m; see `height_mm` of `recording.strokes` for the exact round trip.
    flapped = [(height_mm / 1e3, *speed_and_repeat) for height_mm, *speed_and_repeat in strokes]
    if flapped != flaps or [(stage.height_m, stage.stage) for stage in static] != holds:
        raise BadInput(
            f"{folder}: its stage files are not what its plan begins with; type rfca-rig "
            f"check {folder}"
        )
    carried_ending = {}
    devices = {**header.provenance}
    # Without the photos, which are listed again.
    if ending is not None:
        # A drive tells its firmware and its serial number after it was energised.
        devices.update(ending.provenance)
        for name, text in ending.provenance.items():
            if name in CARRIED_ENDING_KEYS:
                carried_ending[name] = text
    last: dict[str, Any] = next((event for event in reversed(events) if "utc" in event), {})
    return InterruptedRun(
        folder=folder,
        header=header,
        plan=plan,
        # Cycles are numbered over the whole run, so the largest number counts, not the number of
        # rows.
        done=PlanProgress(
            len(strokes), len(static), max((part.last_cycle for part in outlines), default=0)
        ),
        static=static,
        why=why,
        last_seen={name: last[name] for name in ("t_s", "utc") if name in last},
        ending=carried_ending,
        resumed=sum(event["event"] == RESUMED for event in events),
        devices={name: text for name, text in devices.items() if name.startswith(DEVICE_PREFIXES)},
    )


def _plan(folder: Path, header: Recording) -> Plan:
    if header.is_listening:
        raise BadInput(
            f"{folder}: was recorded without motion, so no plan goes on; rfca-rig recover {folder} "
            "makes it whole, rfca-rig record begins another"
        )
    try:
        return parse_plan(header.title, header.provenance)
    except BadInput as error:
        raise BadInput(f"{folder}: cannot go on: {error}") from None


def _why(events: list[dict[str, Any]]) -> str:
    """The reason of the end, from the events since the run began or was last continued; a trip
    takes precedence.
    """
    since = next(
        (index for index in reversed(range(len(events))) if events[index]["event"] == RESUMED), 0
    )
    reasons = [
        str(event["why"])
        for event in events[since:]
        if event["event"] in ("motor off", "run ends") and "why" in event
    ]
    # A trip takes precedence: it is the cause of whatever ended the run after it.
    tripped = [why for why in reasons if why.startswith(TRIP)]
    return (tripped or reasons or [NO_REASON_RECORDED])[-1]


def reopen_run(
    begun: InterruptedRun,
    clock: Clock,
    operator: str,
    seed: int | None,
    changes: Mapping[str, Mapping[str, object]],
    zero_facts: Mapping[str, str],
) -> None:
    """Reopens the run's folder; records when and why it had stopped, who continues it, what is
    not as before (`rig_compatibility.changes_of_event`), and what is known of the drive's zero.
    """
    event = {
        "event": RESUMED,
        "t_s": round(clock.now_s(), 6),
        "utc": clock.wall_time().isoformat(),
        "stopped": begun.why,
        "stopped_at": dict(begun.last_seen),
        "done": {
            "strokes": begun.done.strokes,
            "static_stages": begun.done.holds,
            "last_cycle": begun.done.cycle,
        },
        "ending": dict(begun.ending),
        "operator": operator,
    }
    if seed is not None:
        event["seed"] = seed
    event.update(changes)
    if zero_facts:
        event["zero"] = dict(zero_facts)
    run_folder.reopen(begun.folder, event, begun.resumed)


def ending_of(
    folder: Path,
    known: Mapping[str, str],
    stages: Sequence[StaticStage],
    begun: InterruptedRun | None,
    eye: PhotoSetup | None,
) -> Ending:
    """The run's end with the static stages of all its parts; photos of earlier parts that were
    not read are read now.
    """
    earlier: Sequence[StaticStage] = ()
    if begun is not None:
        earlier = _with_photos_read(begun.static, folder, eye)
        known = {
            **known,
            "resumed": json.dumps(
                [event for event in events_of(folder) if event["event"] == RESUMED],
                ensure_ascii=False,
            ),
        }
    return Ending({**known, **photo_hashes(folder)}, (*earlier, *stages))


def _with_photos_read(
    stages: Sequence[StaticStage], folder: Path, eye: PhotoSetup | None
) -> tuple[StaticStage, ...]:
    if eye is None:
        return tuple(stages)
    # A stage with an overlay has been read already.
    unread = [number for number, stage in enumerate(stages) if not stage.overlay]
    stages = list(stages)
    read = read_stage_photos([stages[number] for number in unread], folder, eye)
    for number, stage in zip(unread, read, strict=True):
        stages[number] = stage
    return tuple(stages)
