"""Text files of a run: its header, its end, and the events in between, whose file is the run's
lock.

One process writes at a time. The lock ends with its process.
"""

import importlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import AppendOnlyFile, write_atomically
from rfca_rig.recording.journal import static_stage_of
from rfca_rig.recording.layout import ENDING, EVENTS, HEADER, is_inside, read_bounded
from rfca_rig.recording.model import Recording, StaticStage, check_header, check_texts

FORMAT = "rfca-run/1"
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Ending:
    """How a run ended: text by name, and its static stages with the angles read from their photos.

    `is_closed` says that `run.h5` and the checksums were made too. None in files of versions that
    did not say so.
    """

    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...] | None = None
    is_closed: bool | None = False


def write_header(folder: Path, header: Recording) -> None:
    """`run.json`, from a recording without strokes and stages."""
    # The key `believed` belongs to the file format; in the code it is `nominal`.
    texts = {name: getattr(header, name) for name in ("title", "source", "known_to", "provenance")}
    _write(folder / HEADER, {"format": FORMAT, "believed": header.nominal} | texts)


def read_header(folder: Path) -> Recording:
    """The recording as it was before its first stage. Raises BadInput where there is none, or
    none of this format.
    """
    path = folder / HEADER
    content = _read(path)
    if content.get("format") != FORMAT:
        raise BadInput(f"{path}: format {content.get('format')!r}, where {FORMAT!r} is needed")
    try:
        provenance = check_texts(content["provenance"])
        return check_header(
            Recording(
                content["title"],
                content["source"],
                content["believed"],
                content["known_to"],
                (),
                (),
                provenance,
            )
        )
    except LookupError as error:
        raise BadInput(f"{path}: {error} is missing") from None
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from None


def write_ending(folder: Path, ending: Ending) -> None:
    """Writes `end.json`; to be called when nothing moves any more."""
    write_atomically(folder / ENDING, ending_bytes(ending))


def ending_bytes(ending: Ending) -> bytes:
    """What `write_ending` writes."""
    content = asdict(ending)
    # The last key, so that two ends of one run differ at their end alone.
    return _bytes_of(
        {**{name: content[name] for name in ("provenance", "static")}, "closed": ending.is_closed}
    )


def read_ending(folder: Path) -> Ending | None:
    """None for a run that has not ended, or was cut short. Raises BadInput for a file that is
    damaged.
    """
    path = folder / ENDING
    if not path.is_file():
        return None
    content = _read(path)
    try:
        if content["static"] is None:
            static = None
        else:
            static = tuple(static_stage_of(stage) for stage in content["static"])
        return Ending(check_texts(content["provenance"]), static, content.get("closed"))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{path}: is not the end of a run: {error}") from None


def run_provenance(
    folder: Path, known: Recording, ending: Ending | None, strokes: int
) -> Mapping[str, str]:
    """Provenance of a run with so many strokes and the static stages of `known`, and how it
    ended, or that it has not.
    """
    provenance = {**known.provenance, "events": events_text(folder)}
    if ending is None:
        interruption = (
            f"the run ended without being finished, after {strokes} strokes and "
            f"{len(known.static)} static stages"
        )
        return {**provenance, INTERRUPTED: interruption}
    return {**provenance, **ending.provenance}


def events_text(folder: Path) -> str:
    """The complete lines of `events.jsonl`; part of a line, from a crash, is ignored."""
    if (folder / EVENTS).is_file():
        content = read_bounded(folder / EVENTS)
    else:
        content = b""
    # Damaged bytes must not keep the other events from being read.
    return content[: complete_lines_length(content)].decode(errors="replace")


def complete_lines_length(content: bytes) -> int:
    """Number of bytes that the complete lines take."""
    return content.rfind(b"\n") + 1


def events_of(folder: Path) -> list[dict[str, Any]]:
    """The events in order. Raises BadInput, with the line, for a line that is no event."""
    return parse_events(events_text(folder), str(folder / EVENTS))


def parse_events(text: str, where: str) -> list[dict[str, Any]]:
    """The events of a text, one a line. Raises BadInput, naming `where` and the line, for a line
    that is no event.
    """
    events = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            event = json.loads(line)
            if not (isinstance(event, dict) and isinstance(event.get("event"), str)):
                raise ValueError("it has no name")
            if "file" in event:
                file = event["file"]
                samples = event.get("samples")
                if not (
                    isinstance(file, str)
                    and is_inside(file)
                    and isinstance(event.get("sha256"), str)
                ):
                    raise ValueError(
                        "its file should be a path in the run's folder, with its SHA-256"
                    )
                if not (
                    isinstance(samples, dict)
                    and all(isinstance(count, int) for count in samples.values())
                ):
                    raise ValueError("its samples should be a count by name of the stream")
            events.append(event)
        except (ValueError, RecursionError) as error:
            raise BadInput(f"{where}:{number}: is no event: {error}") from None
    return events


def _write(path: Path, content: Mapping[str, object]) -> None:
    write_atomically(path, _bytes_of(content))


def _bytes_of(content: Mapping[str, object]) -> bytes:
    return (json.dumps(content, ensure_ascii=False, indent=1) + "\n").encode()


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is no file")
        return dict(json.loads(read_bounded(path)))
    except FileNotFoundError:
        raise BadInput(f"{path}: is not there, so this is no run's folder") from None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None


def lock(events: AppendOnlyFile) -> None:
    """Locks the run until the file is closed. Raises BadInput where another process has the lock.

    On Windows, and on network disks without locks, there is no lock.
    """
    if os.name == "nt":
        return
    fcntl = importlib.import_module("fcntl")
    try:
        # On the open file, not by a file of its own: the system releases it however the process
        # ends.
        fcntl.flock(events.handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        events.close()
        raise BadInput(
            f"{events.path.parent}: the run is still going on; wait for its end"
        ) from None
    except OSError:
        # A disk without locks must not prevent a run.
        return


def check_not_running(folder: Path) -> None:
    """Raises BadInput where the run in `folder` is still going on. Creates an empty file of
    events where there is none.
    """
    events = AppendOnlyFile(folder / EVENTS)
    lock(events)
    events.close()
