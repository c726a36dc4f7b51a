"""How a run went, in words: how it ended, what the shaft did then, how the sensor's zero went, what was lost, who measured."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from rfca_rig.report.run_parts import RunStory
from rfca_rig.report.text import counted, number

Pairs = list[tuple[str, str]]

LONGEST_TEXT = 160
DEVICES = ("motor_", "sensor_", "camera")
HEALTH = ("sensor_records", "tare_drift")  # begin like a device, and say how the run went
TOLD_ELSEWHERE = (
    "events", "limits", "resumed", "ended", "exit_status", "reason", "ended_at", "lasted_s", "worst_loop_gap_ms",
    "ended_in_stage", "standstill", "tare_drift", "sensor_records", "recorder_samples", "interrupted",
)  # fmt: skip


def health(story: RunStory) -> Pairs:
    """What is known of it, each with its limit where it has one."""
    kept = story.recording.provenance
    said = {
        "ended": _ended(kept),
        "in or after": kept.get("ended_in_stage", ""),
        "began": kept.get("started_at", ""),
        "lasted": f"{float(kept['lasted_s']):.1f} s" if "lasted_s" in kept else "",
        "shaft, once the torque was gone": kept.get("standstill", ""),
        "longest gap of the control loop": _gap(story),
        "records of the sensor": kept.get("sensor_records", ""),
        "samples to the recorder": kept.get("recorder_samples", ""),
        "drift of the sensor\u2019s zero": kept.get("tare_drift", ""),
        "zero of the sensor at rest": _tares(story.events),
        "went on": _resumed(kept),
    }
    return [(name, text) for name, text in said.items() if text]


def _ended(kept: Mapping[str, str]) -> str:
    if "ended" not in kept:
        return kept.get("interrupted", "")
    return f"{kept['ended']} (exit status {kept.get('exit_status', '?')}, reason {kept.get('reason', '?')})"


def _gap(story: RunStory) -> str:
    gap_ms = story.recording.provenance.get("worst_loop_gap_ms", "")
    late_s = story.limits.get("late_s")
    return f"{float(gap_ms):.1f} ms" + (f", may be late by {1e3 * late_s:g} ms" if late_s else "") if gap_ms else ""


def _tares(events: Sequence[Mapping[str, Any]]) -> str:
    """fz and its scatter over all rests."""
    fz_N = [float(event["fz_N"]) for event in events if event["event"] == "tare"]
    if not fz_N:
        return ""
    spread = f" ± {np.std(fz_N, ddof=1):.3f}" if len(fz_N) > 1 else ""
    return f"fz {number(float(np.mean(fz_N)), 3)}{spread} N, mean and standard deviation over {counted(len(fz_N), 'rest')} in the air"


def _resumed(kept: Mapping[str, str]) -> str:
    times = json.loads(kept.get("resumed", "[]"))
    return "; ".join(f"at {event['utc']}{_changed(event)}, had stopped: {event['stopped']}" for event in times)


def _changed(event: Mapping[str, Any]) -> str:
    changes = ", ".join(f"{name} {brief(str(value))}" for name, value in event.get("rig_changes", {}).items())
    return f" with {changes}" if changes else ""


def devices(kept: Mapping[str, str]) -> Pairs:
    """What they said of themselves."""
    return [(_words(name), brief(text)) for name, text in sorted(kept.items()) if name.startswith(DEVICES) and not _is_elsewhere(name)]


def provenance(kept: Mapping[str, str]) -> Pairs:
    """What has no other place on the page."""
    return [(_words(n), brief(text)) for n, text in sorted(kept.items()) if not n.startswith(DEVICES) and n not in TOLD_ELSEWHERE]


def _is_elsewhere(name: str) -> bool:
    return name in TOLD_ELSEWHERE or name.startswith("camera_file")


def _words(name: str) -> str:
    return name.replace("_", " ")


def brief(text: str) -> str:
    """Short text as it stands, but of a path only its last part; of long text its length and a hash to know it by."""
    if len(text) > LONGEST_TEXT or "\n" in text.strip():
        return f"text of {counted(len(text.splitlines()), 'line')}, sha256 {hashlib.sha256(text.encode()).hexdigest()[:16]}…"
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return PureWindowsPath(text).name
    return text
