"""From the journal of a stage to its file. A stage that ends in good order goes the same way as one that a crash left."""

import json
from dataclasses import replace
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.blocks import Begin, End, start_of
from rfca_rig.recording.form import RawStage, Recording, Stroke
from rfca_rig.recording.journal import Block, Kind, whole_blocks
from rfca_rig.recording.rows import RowPile
from rfca_rig.recording.store import write_recording

INTERRUPTED = "the recording was interrupted"


def bare(header: Recording) -> Recording:
    """What a stage's file repeats of its run's header."""
    return replace(header, believed={}, known_to={}, strokes=(), static=(), provenance={})


def stage_in(journal: Path, header: Recording) -> Recording | None:
    """What the journal holds up to its last whole block, as a recording of one stage; None where it holds no sample.

    Raises BadInput for blocks that are whole and yet make no sense.
    """
    blocks, _ = whole_blocks(journal.read_bytes())
    try:
        return _stage(blocks, bare(header))
    except (ValueError, LookupError, TypeError) as error:
        raise BadInput(f"{journal}: is no journal of a stage: {type(error).__name__}: {error}") from None


def _stage(blocks: list[Block], header: Recording) -> Recording | None:
    if not blocks or blocks[0].kind is not Kind.BEGIN:
        return None
    begin, start, end = Begin.of(blocks[0]), None, End(cut_short=INTERRUPTED)
    pile = RowPile(begin.forms)
    for block in blocks[1:]:
        match block.kind:
            case Kind.SAMPLES:
                pile.add(block.payload)
            case Kind.START:
                start = start_of(block)
            case Kind.END:
                end = End.of(block)
    streams = pile.streams(start)
    if end.stroke:
        return replace(header, strokes=(Stroke(begin.height_m, end.stroke.speed_rad_s, end.stroke.repeat, streams),))
    if not any(len(stream.t_s) for stream in streams.values()):
        return None
    raw = (RawStage(begin.label, begin.height_m, streams, end.cut_short),)
    return replace(header, static=(end.static,) if end.static else (), raw=raw)


def write_stage(stage: Recording, path: Path) -> Path:
    """Returns when the stage is on disk: that is when it counts as recorded. Raises RigError, DiskFull."""
    return write_recording(stage, path)


def samples_in(stage: Recording) -> dict[str, int]:
    """How many samples each stream of a stage has."""
    streams = [*(stroke.streams for stroke in stage.strokes), *(raw.streams for raw in stage.raw)]
    return {name: len(stream.t_s) for some in streams for name, stream in some.items()}


def event_of(stage: Recording, name: str, sha256: str) -> bytes:
    """The line that says a stage is on disk."""
    cut_short = next((raw.cut_short for raw in stage.raw), "")
    what = {"event": "stage cut short", "why": cut_short} if cut_short else {"event": "stage recorded"}
    return (json.dumps({**what, "file": name, "sha256": sha256, "samples": samples_in(stage)}, ensure_ascii=False) + "\n").encode()
