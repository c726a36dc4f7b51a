"""Reads a run's folder into its line of the logbook: from three small text files, or from run.h5 where that is all there is."""

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
from rfca_rig.recording.identity import identity_of, identity_of_tables
from rfca_rig.recording.layout import ENDING, EVENTS, EXPERIMENT, HEADER, PENDULUM, RECORDING

REASONS = {"done": "done", "stopped": "stopped", "worn-out": "worn out"}
MEASURED = ("Flap", "Hold", "Cycles")
WITH_SPEED = ("Flap", "Cycles")


def entry_in(runs: Path, folder: str, measure_s: Callable[[Path], float | None] = lambda _: None) -> Entry:
    """The entry of a run's folder; of one whose files cannot be read it says so. `measure_s` reads how long an experiment lasts."""
    path = runs / folder
    try:
        if (path / HEADER).is_file():
            return _of_run(path, folder)
        if (path / RECORDING).is_file():
            return _of_recording(path, folder)
        return _of_pendulum(path, folder) if (path / PENDULUM).is_file() else _of_experiment(path, folder, measure_s(path))
    except (BadInput, OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        why = str(error) if isinstance(error, BadInput) else f"{type(error).__name__}: {error}"
        return Entry(folder, path.name, "", "", _changed_s(path), ended="damaged", why=why)


def _of_run(path: Path, folder: str) -> Entry:
    header = json.loads((path / HEADER).read_bytes())
    events_text = _whole_lines(path / EVENTS)
    ending = json.loads((path / ENDING).read_bytes())["provenance"] if (path / ENDING).is_file() else None
    known: Mapping[str, str] = header["provenance"]
    done = _told(events_text.splitlines(), json.loads(known["plan"]))
    whole = {**known, "events": events_text, **(ending or {})}
    ended, code, why = ("unfinished", "", "it goes on, or was cut off") if ending is None else _end(ending)
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
        identity_of(header["title"], header["source"], whole),
    )


def _whole_lines(path: Path) -> str:
    content = path.read_bytes() if path.is_file() else b""
    return content[: content.rfind(b"\n") + 1].decode(errors="replace")


@dataclass
class _Done:
    """What the events say was recorded; conditions of stages that were cut short are among them."""

    conditions: dict[LoggedCondition, None] = field(default_factory=dict)
    strokes: int = 0
    static_stages: int = 0
    cycles: int = 0

    def add(self, stage: Mapping[str, Any], samples: Mapping[str, int]) -> None:
        self.strokes += stage["stage"] == "Flap"
        self.static_stages += stage["stage"] == "Hold"
        self.cycles += samples.get("cycles", 0)


def _told(lines: Iterable[str], plan: Sequence[Mapping[str, Any]]) -> _Done:
    """Stages are acknowledged in the order in which they began; one that was waited for when the run was cut off is not any more."""
    by_label = {stage["label"]: stage for stage in plan}
    done, begun = _Done(), deque[Mapping[str, Any]]()
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
            case "run resumed":
                begun.clear()
    return done


def _condition(stage: Mapping[str, Any]) -> LoggedCondition:
    return LoggedCondition(round(1e3 * stage["height_m"], 6), stage["speed_rad_s"] if stage["stage"] in WITH_SPEED else None)


def _end(ending: Mapping[str, str]) -> tuple[str, str, str]:
    """(one of ENDINGS, a trip's code, words)."""
    why = ending.get("ended", "")
    reason = ending.get("reason", "")
    if why.startswith(TRIP):
        return "tripped", reason, why
    if "interrupted" in ending and not why:
        return "interrupted", "", ending["interrupted"]
    return REASONS.get(reason, "done" if why == "done" else "failed"), "", why


def _of_recording(path: Path, folder: str) -> Entry:
    """A run that is nothing but run.h5: imported, made of photos taken by hand, or of an older version."""
    from rfca_rig.recording.outline import outline_of  # noqa: PLC0415  (takes longer to load than a thousand runs to list)

    outline = outline_of(path / RECORDING)
    known = outline.provenance
    conditions = [LoggedCondition(height, speed) for height, speed, _repeat in outline.strokes]
    conditions += [LoggedCondition(round(1e3 * stage.height_m, 6)) for stage in outline.static]
    ended, code, why = _end(known) if {"ended", "interrupted"} & set(known) else ("", "", "")
    guessed = "static" if outline.static and not outline.strokes else "dynamic"
    return Entry(
        folder,
        outline.title,
        outline.source,
        "imported" if outline.source == "IMPORT" else known.get("experiment", guessed),
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
    """Recordings of a pendulum; whether its tables can be used is for the commands that read them."""
    described = tomllib.loads((path / PENDULUM).read_text(encoding="utf-8"))
    title = str(described["title"])
    return Entry(
        folder,
        title,
        "IMPORT",
        "imported",
        (path / PENDULUM).stat().st_mtime,
        swings=len(described["runs"]),
        identity=identity_of_tables(title, path),
    )


def _of_experiment(path: Path, folder: str, seconds: float | None) -> Entry:
    """Recordings of a mechanism; whether they can be used is for the commands that read them."""
    described = tomllib.loads((path / EXPERIMENT).read_text(encoding="utf-8"))
    title, recordings = str(described["title"]), described["recordings"]
    return Entry(
        folder,
        title,
        "IMPORT",
        "imported",
        (path / EXPERIMENT).stat().st_mtime,
        motions=len(recordings),
        named_conditions=tuple(dict.fromkeys(str(one["condition"]) for one in recordings)),
        seconds=seconds,
        identity=identity_of_tables(title, path),
    )


def _began_s(file: Path, source: str, known: Mapping[str, str]) -> float:
    """A twin's clock begins every run at the same moment; what tells when it was run is when its first file was written."""
    if source == "REAL" and "started_at" in known:
        return datetime.fromisoformat(known["started_at"]).timestamp()
    return file.stat().st_mtime


def _changed_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
