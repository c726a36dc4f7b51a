"""Reads a run's folder into its logbook entry: from three small text files, or from run.h5 where
that is all there is.
"""

import json
import tomllib
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from rfca_rig.errors import TRIP, BadInput
from rfca_rig.logbook.entry import Entry, LoggedCondition
from rfca_rig.recording.layout import (
    ENDING,
    EVENTS,
    EXPERIMENT,
    HEADER,
    MOST_TEXT_BYTES,
    PENDULUM,
    RECORDING,
    identity_of,
    identity_of_tables,
    refuse_links_among,
)

REASONS = {"done": "done", "stopped": "stopped", "worn-out": "worn out"}
MEASURED = ("Flap", "Hold", "Cycles")
WITH_SPEED = ("Flap", "Cycles")


def read_entry(
    runs: Path, folder: str, measure_s: Callable[[Path], float | None] = lambda _: None
) -> Entry:
    """The entry of a run's folder; where its files cannot be read, the entry says so.
    `measure_s` returns an experiment's duration.
    """
    path = runs / folder
    try:
        refuse_links_among(path, (HEADER, EVENTS, ENDING, RECORDING))
        if (path / HEADER).is_file():
            return _of_run(path, folder)
        if (path / RECORDING).is_file():
            return _of_recording(path, folder)
        if (path / PENDULUM).is_file():
            return _of_pendulum(path, folder)
        return _of_experiment(path, folder, measure_s(path))
    # One damaged run must not keep the others from being listed.
    except (
        BadInput,
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        if isinstance(error, BadInput):
            why = str(error)
        else:
            why = f"{type(error).__name__}: {error}"
        return Entry(
            folder, path.name, "", "", _modification_time_s(path), ended="damaged", why=why
        )


def _of_run(path: Path, folder: str) -> Entry:
    header = json.loads(_read_bytes(path / HEADER))
    events_text = _whole_lines(path / EVENTS)
    if (path / ENDING).is_file():
        ending = json.loads(_read_bytes(path / ENDING))["provenance"]
    else:
        ending = None
    known: Mapping[str, str] = header["provenance"]
    done = _count_recorded(events_text.splitlines(), json.loads(known["plan"]))
    # The same texts, in the same shape, as `run.h5` has: the identity must agree with that of the
    # recording.
    provenance = {**known, "events": events_text, **(ending or {})}
    # Without `end.json` the two cases look the same from outside.
    if ending is None:
        ended = "unfinished"
        code = ""
        why = "it goes on, or was cut off"
    else:
        ended, code, why = _end(ending)
    return Entry(
        folder,
        header["title"],
        header["source"],
        known.get("experiment", ""),
        _began_s(path / HEADER, header["source"], known),
        known.get("operator", ""),
        known.get("sample", ""),
        tuple(done.conditions),
        done.strokes,
        done.static_stages,
        done.cycles,
        ended,
        code,
        why,
        identity_of(header["title"], header["source"], provenance),
    )


def read_provenance(run: Path) -> dict[str, str]:
    """The provenance in the header of a run that is listed as sound; none for other recordings."""
    if not (run / HEADER).is_file():
        return {}
    provenance: dict[str, str] = json.loads(_read_bytes(run / HEADER))["provenance"]
    return provenance


def _whole_lines(path: Path) -> str:
    if not path.is_file():
        return ""
    content = _read_bytes(path)
    # A crash may have left part of a line.
    return content[: content.rfind(b"\n") + 1].decode(errors="replace")


def _read_bytes(path: Path) -> bytes:
    if not path.is_file():
        # A pipe would be waited for, and a device may never end.
        raise ValueError(f"{path.name} is no file")
    if path.stat().st_size > MOST_TEXT_BYTES:
        raise ValueError(f"{path.name} has more than {MOST_TEXT_BYTES / 1e6:.0f} MB")
    return path.read_bytes()


@dataclass
class _Done:
    """Recorded stages by the events; conditions include those of stages that were cut short."""

    conditions: dict[LoggedCondition, None] = field(default_factory=dict)
    strokes: int = 0
    static_stages: int = 0
    cycles: int = 0

    def add(self, stage: Mapping[str, Any], samples: Mapping[str, int]) -> None:
        self.strokes += stage["stage"] == "Flap"
        self.static_stages += stage["stage"] == "Hold"
        self.cycles += samples.get("cycles", 0)


def _count_recorded(lines: Iterable[str], plan: Sequence[Mapping[str, Any]]) -> _Done:
    """Stages are acknowledged in the order in which they began. Stages still open when a run was
    cut off are never acknowledged.
    """
    # Events name stages by label only; the plan has the rest.
    by_label = {stage["label"]: stage for stage in plan}
    done = _Done()
    begun = deque[Mapping[str, Any]]()
    for line in lines:
        event = json.loads(line)
        match event["event"]:
            case "stage begins":
                stage = by_label.get(event["stage"], {"stage": ""})
                begun.append(stage)
                if stage["stage"] in MEASURED:
                    done.conditions[_condition(stage)] = None
            case "stage recorded" if begun:
                done.add(begun.popleft(), event["samples"])
            case "stage cut short" if begun:
                begun.popleft()
            # Stages still open then were interrupted; they are repeated under the same labels.
            case "run resumed":
                begun.clear()
    return done


def _condition(stage: Mapping[str, Any]) -> LoggedCondition:
    speed_rad_s = None
    if stage["stage"] in WITH_SPEED:
        speed_rad_s = stage["speed_rad_s"]
    return LoggedCondition(round(1e3 * stage["height_m"], 6), speed_rad_s)


def _end(ending: Mapping[str, str]) -> tuple[str, str, str]:
    """(one of ENDINGS, a trip's code, words)."""
    why = ending.get("ended", "")
    reason = ending.get("reason", "")
    if why.startswith(TRIP):
        return "tripped", reason, why
    # `recover` wrote this end, so the run itself had no time to.
    if "interrupted" in ending and not why:
        return "interrupted", "", ending["interrupted"]
    if reason in REASONS:
        return REASONS[reason], "", why
    if why == "done":
        return "done", "", why
    return "failed", "", why


def _of_recording(path: Path, folder: str) -> Entry:
    """A run that is only a run.h5: imported, made of photos taken by hand, or of an older
    version.
    """
    from rfca_rig.recording.store import outline_of  # noqa: PLC0415  (takes longer to load than a thousand runs to list)

    outline = outline_of(path / RECORDING)
    known = outline.provenance
    conditions = [LoggedCondition(height, speed) for height, speed, _repeat in outline.strokes]
    conditions += [LoggedCondition(round(1e3 * stage.height_m, 6)) for stage in outline.static]
    # Imported recordings have neither text: how they ended is unknown.
    if {"ended", "interrupted"} & set(known):
        ended, code, why = _end(known)
    else:
        ended = ""
        code = ""
        why = ""
    if outline.source == "IMPORT":
        kind = "imported"
    elif outline.static and not outline.strokes:
        kind = known.get("experiment", "static")
    else:
        kind = known.get("experiment", "dynamic")
    return Entry(
        folder,
        outline.title,
        outline.source,
        kind,
        _began_s(path / RECORDING, outline.source, known),
        known.get("operator", ""),
        known.get("sample", ""),
        tuple(dict.fromkeys(conditions)),
        len(outline.strokes),
        len(outline.static),
        outline.cycles,
        ended,
        code,
        why,
        identity_of(outline.title, outline.source, known),
    )


def _of_pendulum(path: Path, folder: str) -> Entry:
    """Recordings of a pendulum; whether their tables are usable is for the commands that read
    them.
    """
    description = tomllib.loads(_read_bytes(path / PENDULUM).decode())
    title = str(description["title"])
    return Entry(
        folder,
        title,
        "IMPORT",
        "imported",
        (path / PENDULUM).stat().st_mtime,
        swings=len(description["runs"]),
        identity=identity_of_tables(title, path),
    )


def _of_experiment(path: Path, folder: str, seconds: float | None) -> Entry:
    """Recordings of a mechanism; whether they are usable is for the commands that read them."""
    description = tomllib.loads(_read_bytes(path / EXPERIMENT).decode())
    title = str(description["title"])
    recordings = description["recordings"]
    return Entry(
        folder,
        title,
        "IMPORT",
        "imported",
        (path / EXPERIMENT).stat().st_mtime,
        motions=len(recordings),
        named_conditions=tuple(
            dict.fromkeys(str(recording["condition"]) for recording in recordings)
        ),
        seconds=seconds,
        identity=identity_of_tables(title, path),
    )


def _began_s(file: Path, source: str, known: Mapping[str, str]) -> float:
    """A twin's clock begins every run at the same moment, so for a twin the time of its first
    file counts.
    """
    if source == "REAL" and "started_at" in known:
        return datetime.fromisoformat(known["started_at"]).timestamp()
    return file.stat().st_mtime


def _modification_time_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
