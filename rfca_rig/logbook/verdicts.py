"""What diagnoses said, and of which recordings."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import Any

from rfca_rig.logbook.entry import Verdict
from rfca_rig.logbook.finding import Found
from rfca_rig.recording.layout import DIAGNOSIS


def diagnoses_near(runs: Path, found: Iterable[Found]) -> Iterator[tuple[Path, os.stat_result]]:
    """The files of diagnoses beside the folder of all runs, where the user stands, and in the folders of runs; each once."""
    seen: set[Path] = set()
    around = (file for place in (runs.absolute().parent, Path.cwd()) for way in (DIAGNOSIS, f"*/{DIAGNOSIS}") for file in place.glob(way))
    within = (Path(file).absolute() for one in found for file in one.diagnoses)
    for file in (*around, *within):
        if file not in seen and (stat := _stat(file)) is not None:
            seen.add(file)
            yield file, stat


def _stat(file: Path) -> os.stat_result | None:
    """None for what is no file, or not any more."""
    try:
        stat = file.stat()
    except OSError:
        return None
    return stat if S_ISREG(stat.st_mode) else None


def stamp_of(stat: os.stat_result) -> str:
    """Changes whenever the file does."""
    return f"{stat.st_mtime_ns}:{stat.st_size}:{stat.st_ino}"


GRADED = ("mostly", "family")  # grades that the words of rfca-diagnosis/1 do not tell from "unexplained"


def verdict_in(file: Path) -> dict[str, Any]:
    """What the file says, as plain data: its verdict, and the identities of its recordings; none where it is no diagnosis."""
    try:
        said = json.loads(file.read_bytes())
        named = [one["identity"] for one in said.get("recordings", [])]
        effects = [str(effect["id"]) for effect in said["effects"]]
        sure = [effect["probability"] for effect in said["effects"] if effect["probability"] is not None]
        words = said["grade"] if said.get("grade") in GRADED else said["verdict"]
        return {"identities": named, "words": str(words), "effects": effects, "probability": max(sure, default=None)}
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return {"identities": []}


def by_identity(said: Iterable[tuple[str, float, Mapping[str, Any]]]) -> dict[str, Verdict]:
    """The newest verdict on each recording, from (file, when it was written, what `verdict_in` gave)."""
    verdicts: dict[str, Verdict] = {}
    for file, _, one in sorted(said, key=lambda each: each[1]):
        for identity in one["identities"]:
            verdicts[identity] = Verdict(one["words"], tuple(one["effects"]), one["probability"], file)
    return verdicts
