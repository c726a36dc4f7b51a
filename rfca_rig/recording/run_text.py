"""What a run writes in words: what it began with, how it ended, and what happened in between."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.blocks import static_stage_of
from rfca_rig.recording.layout import ENDING, EVENTS, HEADER
from rfca_rig.recording.model import Recording, StaticStage

FORMAT = "rfca-run/1"
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Ending:
    """How a run ended: text by name, and its static stages with what was read off their photos since they were recorded."""

    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...] | None = None


def write_header(folder: Path, header: Recording) -> None:
    """`run.json`, from a recording without strokes and stages."""
    texts = {name: getattr(header, name) for name in ("title", "source", "known_to", "provenance")}
    _write(folder / HEADER, {"format": FORMAT, "believed": header.nominal} | texts)


def read_header(folder: Path) -> Recording:
    """The recording as it was before its first stage. Raises BadInput where there is none, or none of this format."""
    path = folder / HEADER
    said = _read(path)
    if said.get("format") != FORMAT:
        raise BadInput(f"{path}: format {said.get('format')!r}, where {FORMAT!r} is needed")
    try:
        return Recording(said["title"], said["source"], said["believed"], said["known_to"], (), (), said["provenance"])
    except LookupError as error:
        raise BadInput(f"{path}: {error} is missing") from None


def write_ending(folder: Path, ending: Ending) -> None:
    """`end.json`; for once nothing moves any more."""
    _write(folder / ENDING, asdict(ending))


def read_ending(folder: Path) -> Ending | None:
    """None for a run that has not ended, or was cut short. Raises BadInput for a file that is damaged."""
    path = folder / ENDING
    if not path.is_file():
        return None
    said = _read(path)
    try:
        static = None if said["static"] is None else tuple(static_stage_of(stage) for stage in said["static"])
        return Ending(said["provenance"], static)
    except (LookupError, TypeError) as error:
        raise BadInput(f"{path}: is not the end of a run: {error}") from None


def run_provenance(folder: Path, known: Recording, ending: Ending | None, strokes: int) -> Mapping[str, str]:
    """Where a run with so many strokes and the static stages of `known` comes from, and how it ended; one that has not ended says so."""
    found = {**known.provenance, "events": events_text(folder)}
    if ending is None:
        said = f"the run ended without being finished, after {strokes} strokes and {len(known.static)} static stages"
        return {**found, INTERRUPTED: said}
    return {**found, **ending.provenance}


def events_text(folder: Path) -> str:
    """The whole lines of `events.jsonl`; what a crash left of another one is passed over."""
    path = folder / EVENTS
    content = path.read_bytes() if path.is_file() else b""
    return content[: whole_lines(content)].decode(errors="replace")


def whole_lines(content: bytes) -> int:
    """How many bytes they take."""
    return content.rfind(b"\n") + 1


def events_of(folder: Path) -> list[dict[str, Any]]:
    """What happened, in its order. Raises BadInput, with the line, for what is no event."""
    events = []
    for number, line in enumerate(events_text(folder).splitlines(), start=1):
        try:
            events.append(dict(json.loads(line)))
        except (ValueError, TypeError, RecursionError) as error:
            raise BadInput(f"{folder / EVENTS}:{number}: is no event: {error}") from None
    return events


def _write(path: Path, content: Mapping[str, object]) -> None:
    write_atomically(path, (json.dumps(content, ensure_ascii=False, indent=1) + "\n").encode())


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_bytes()))
    except FileNotFoundError:
        raise BadInput(f"{path}: is not there, so this is no run's folder") from None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None
