"""Health of a run in words: its end, the shaft's motion after it, drift of the sensor's zero, losses, devices."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from rfca_rig.report.run_parts import RunStory
from rfca_rig.report.text import count_noun, number

Pairs = list[tuple[str, str]]

# Longer texts of the provenance are shown as length and hash.
LONGEST_TEXT = 160
DEVICES = ("motor_", "sensor_", "camera")
HEALTH = ("sensor_records", "tare_drift")  # begin like a device, and say how the run went
# Keys that another part of the page shows.
SHOWN_ELSEWHERE = (
    "events", "limits", "resumed", "ended", "exit_status", "reason", "ended_at", "lasted_s", "worst_loop_gap_ms",
    "ended_in_stage", "standstill", "tare_drift", "sensor_records", "recorder_samples", "interrupted",
)  # fmt: skip


def health(story: RunStory) -> Pairs:
    """Health of a run: pairs of name and text, with the limit where there is one."""
    known = story.recording.provenance
    texts = {
        "ended": _end_text(known),
        "in or after": known.get("ended_in_stage", ""),
        "began": known.get("started_at", ""),
        "lasted": f"{float(known['lasted_s']):.1f} s" if "lasted_s" in known else "",
        "shaft, once the torque was gone": known.get("standstill", ""),
        "longest gap of the control loop": _gap(story),
        "records of the sensor": known.get("sensor_records", ""),
        "samples to the recorder": known.get("recorder_samples", ""),
        "drift of the sensor\u2019s zero": known.get("tare_drift", ""),
        "zero of the sensor at rest": _tares(story.events),
        "went on": _resume_text(known),
    }
    return [(name, text) for name, text in texts.items() if text]


def _end_text(known: Mapping[str, str]) -> str:
    if "ended" not in known:
        return known.get("interrupted", "")
    return f"{known['ended']} (exit status {known.get('exit_status', '?')}, reason {known.get('reason', '?')})"


def _gap(story: RunStory) -> str:
    gap_ms = story.recording.provenance.get("worst_loop_gap_ms", "")
    late_s = story.limits.get("late_s")
    return f"{float(gap_ms):.1f} ms" + (f", may be late by {1e3 * late_s:g} ms" if late_s else "") if gap_ms else ""


def _tares(events: Sequence[Mapping[str, Any]]) -> str:
    """Mean and standard deviation of fz over all rests in the air."""
    fz_N = [float(event["fz_N"]) for event in events if event["event"] == "tare"]
    if not fz_N:
        return ""
    spread = f" ± {np.std(fz_N, ddof=1):.3f}" if len(fz_N) > 1 else ""
    return f"fz {number(float(np.mean(fz_N)), 3)}{spread} N, mean and standard deviation over {count_noun(len(fz_N), 'rest')} in the air"


def _resume_text(known: Mapping[str, str]) -> str:
    times = json.loads(known.get("resumed", "[]"))
    return "; ".join(f"at {event['utc']}{_changes_text(event)}, had stopped: {event['stopped']}" for event in times)


def _changes_text(event: Mapping[str, Any]) -> str:
    changes = ", ".join(f"{name} {shorten(str(value))}" for name, value in event.get("rig_changes", {}).items())
    return f" with {changes}" if changes else ""


def devices(kept: Mapping[str, str]) -> Pairs:
    """What the devices reported of themselves: pairs of name and text."""
    return [(_words(name), shorten(text)) for name, text in sorted(kept.items()) if name.startswith(DEVICES) and not _is_elsewhere(name)]


def provenance(kept: Mapping[str, str]) -> Pairs:
    """Provenance that no other part of the page shows: pairs of name and text."""
    return [(_words(n), shorten(text)) for n, text in sorted(kept.items()) if not n.startswith(DEVICES) and n not in SHOWN_ELSEWHERE]


def _is_elsewhere(name: str) -> bool:
    return name in SHOWN_ELSEWHERE or name.startswith("camera_file")


def _words(name: str) -> str:
    return name.replace("_", " ")


def shorten(text: str) -> str:
    """Short text unchanged, but only the last part of an absolute path; length and hash of a long text."""
    if len(text) > LONGEST_TEXT or "\n" in text.strip():
        return f"text of {count_noun(len(text.splitlines()), 'line')}, sha256 {hashlib.sha256(text.encode()).hexdigest()[:16]}…"
    # Both kinds: a recording may come from another system. PureWindowsPath also splits at "/".
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return PureWindowsPath(text).name
    return text
