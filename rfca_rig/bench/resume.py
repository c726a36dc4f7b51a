"""Continues a stopped run in its own folder, and joins what it recorded before and after."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from rfca_rig.bench.begun import RESUMED, InterruptedRun
from rfca_rig.bench.stage_photos import photo_hashes, read_stage_photos
from rfca_rig.clock import Clock
from rfca_rig.recording import run_folder
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.run_text import Ending, events_of
from rfca_rig.vision.leg_photo import PhotoSetup


def reopen_run(begun: InterruptedRun, clock: Clock, operator: str, seed: int | None, rig_changes: Mapping[str, str]) -> None:
    """Reopens the run's folder; records when and why it had stopped, who continues it, and what has changed."""
    event = {
        "event": RESUMED,
        "t_s": round(clock.now_s(), 6),
        "utc": clock.wall_time().isoformat(),
        "stopped": begun.why,
        "stopped_at": dict(begun.last_seen),
        "done": {"strokes": begun.done.strokes, "static_stages": begun.done.holds, "last_cycle": begun.done.cycle},
        "ending": dict(begun.ending),
        "operator": operator,
        **({} if seed is None else {"seed": seed}),
        **({"rig_changes": dict(rig_changes)} if rig_changes else {}),
    }
    run_folder.reopen(begun.folder, event, begun.resumed)


def ending_of(
    folder: Path, known: Mapping[str, str], stages: Sequence[StaticStage], begun: InterruptedRun | None, eye: PhotoSetup | None
) -> Ending:
    """The run's end with the static stages of all its parts; photos of earlier parts that were not read are read now."""
    earlier = () if begun is None else _with_photos_read(begun.static, folder, eye)
    resumed_text = {} if begun is None else {"resumed": _resumed_text(folder)}
    return Ending({**known, **resumed_text, **photo_hashes(folder)}, (*earlier, *stages))


def _with_photos_read(stages: Sequence[StaticStage], folder: Path, eye: PhotoSetup | None) -> tuple[StaticStage, ...]:
    if eye is None:
        return tuple(stages)
    # A stage with an overlay has been read already.
    read = iter(read_stage_photos([stage for stage in stages if not stage.overlay], folder, eye))
    return tuple(stage if stage.overlay else next(read) for stage in stages)


def _resumed_text(folder: Path) -> str:
    """Each continuation, from the run's events, as JSON."""
    return json.dumps([event for event in events_of(folder) if event["event"] == RESUMED], ensure_ascii=False)
