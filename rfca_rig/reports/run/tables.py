"""Tables of a run: parts, conditions planned and done, clock drift, events, stiffness checks.

Drift of each device's clock relative to the host's, from the two times that every sample carries.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.repeats import STDS_OF_95
from rfca_rig.analysis.static_forces import stiffness_drift
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Cycles, Flap, StiffnessCheck, cycles_in
from rfca_rig.recording.can_frames import CAN
from rfca_rig.recording.columns import DEVICE_TIME, HOST_TIME
from rfca_rig.recording.model import RawStage, Recording, Stream, Stroke
from rfca_rig.recording.tables import CYCLES
from rfca_rig.reports.run.parts import RunPart, RunStory
from rfca_rig.reports.table import Table, TableColumn, TableRow, Value

Floats = NDArray[np.float64]

# From each block of this length, the sample with the shortest delay counts.
BLOCK_S = 0.25
# A line through fewer points says little about a slope.
FEWEST_BLOCKS = 4

# Rows on the page; the CSV has all.
MOST_ROWS = 60
# Events that every run has, which the table of events leaves out.
ORDINARY = ("stage begins", "stage recorded", "clocks", "tare", "cycles counted", "run ends")
# Keys of an event that the page shows in another place.
SHOWN_ELSEWHERE = (
    "event",
    "t_s",
    "utc",
    "ending",
    "stopped_at",
    "sha256",
    "worst_loop_gap_ms",
    "standstill",
    "tare_drift",
)

LOADS = (
    TableColumn("peak_force_N", "peak", digits=1, over="Force"),
    TableColumn("expected_force_N", "expected", digits=1, over="Force"),
    TableColumn("force_of_limit_pct", "of limit", digits=0, over="Force"),
    TableColumn("peak_moment_Nm", "peak", digits=2, over="Moment"),
    TableColumn("expected_moment_Nm", "expected", digits=2, over="Moment"),
    TableColumn("moment_of_limit_pct", "of limit", digits=0, over="Moment"),
)


@dataclass(frozen=True)
class ClockDrift:
    """Clock drift of one device: `ppm`, positive where the device's clock is faster than the
    host's.

    It comes from `blocks` blocks of a quarter of a second over `span_s`. `half_ppm` bounds the
    error from uneven arrival: the loop polls only so often, so that a sample at either end may be
    early or late by the whole observed spread. It is a bound without a confidence level, because
    such errors are not noise.
    """

    device: str
    ppm: float
    half_ppm: float
    span_s: float
    blocks: int


def clock_drifts(recording: Recording) -> list[ClockDrift]:
    """Drift of each device whose samples carry both clocks.

    A sample arrives late, never early: in each quarter of a second, the sample with the shortest
    delay counts. Where a device was restarted within the run, only samples since the last restart
    count.
    """
    stages: Sequence[Stroke | RawStage] = (*recording.strokes, *recording.raw)
    # Frames on a bus carry no time of their sender.
    without_clock = (CYCLES, CAN)
    names = dict.fromkeys(
        name for stage in stages for name in stage.streams if name not in without_clock
    )
    drifts = []
    for name in names:
        drift = _drift(name, [stage.streams[name] for stage in stages if name in stage.streams])
        if drift is not None:
            drifts.append(drift)
    return drifts


def _drift(device: str, streams: Sequence[Stream]) -> ClockDrift | None:
    pairs = sorted(pair for stream in streams for pair in _shortest_delays(stream))
    host_s, device_s = np.array(pairs).reshape(-1, 2).T
    restarts = np.flatnonzero(np.diff(device_s) < 0.0)
    since = 0
    if len(restarts):
        since = int(restarts[-1]) + 1
    ahead_s = (device_s - host_s)[since:]
    host_s = host_s[since:]
    if len(host_s) < FEWEST_BLOCKS or np.ptp(host_s) < BLOCK_S:
        return None
    # Least squares of (device - host) over host time: the slope is the drift itself, a small number
    # without cancellation.
    centred = host_s - host_s.mean()
    slope = float(centred @ ahead_s) / float(centred @ centred)
    uneven_s = float(np.ptp(ahead_s - slope * centred))
    # The worst case: the whole spread of one sign at the first block, of the other sign at the last
    # one.
    span_s = float(np.ptp(host_s))
    return ClockDrift(device, 1e6 * slope, 2e6 * uneven_s / span_s, span_s, len(host_s))


def _shortest_delays(stream: Stream) -> Iterator[tuple[float, float]]:
    """Host and device time in s of the sample with the shortest delay in each block."""
    if HOST_TIME not in stream.columns or DEVICE_TIME not in stream.columns:
        return
    # By clocks that all stages share.
    host_s = stream.columns[HOST_TIME].values
    device_s = stream.columns[DEVICE_TIME].values
    if not len(host_s):
        return
    block = ((host_s - host_s[0]) // BLOCK_S).astype(int)
    late_s = host_s - device_s
    for number in np.unique(block):
        of_it = np.flatnonzero(block == number)
        best = int(of_it[np.argmin(late_s[of_it])])
        yield float(host_s[best]), float(device_s[best])


def stages_table(story: RunStory) -> Table:
    """A row for each part, complete or cut short."""
    columns = (
        TableColumn("begun_s", "Begins", digits=1),
        TableColumn("stage", "Stage"),
        TableColumn("kind", role="kept"),
        TableColumn("condition", role="kept"),
        TableColumn("samples", "Samples"),
        *LOADS,
        TableColumn("cut_short", role="note"),
    )
    rows = tuple(TableRow(_stage(part), marked=bool(part.ended)) for part in story.parts)
    return Table("stages", f"Every part once (n = 1). {loads_sentence(story)}", columns, rows)


def _stage(part: RunPart) -> dict[str, Value]:
    begun_s = None
    if part.begun:
        begun_s = part.begun.t_s
    cut_short = ""
    if part.ended:
        cut_short = f"cut short: {part.ended}"
    return {
        "begun_s": begun_s,
        "stage": part.label,
        "kind": part.kind,
        "condition": part.condition,
        "samples": part.samples,
        **_loads(part),
        "cut_short": cut_short,
    }


def loads_sentence(story: RunStory) -> str:
    """Sentence on the columns of loads, with the limits of force and moment."""
    limits = story.limits
    text = (
        "Peak: the largest single sample of all axes together, as the limits see it. "
        "Expected: force in the plane of motion and moment "
        "about the shaft, by the nominal model"
    )
    if "force_N" not in limits:
        return f"{text}. No limits are recorded."
    later = story.last_limits
    if later != limits:
        changed = f", later {later['force_N']:g} N and {later['torque_Nm']:g} N m"
    else:
        changed = ""
    return f"{text}. Limits {limits['force_N']:g} N and {limits['torque_Nm']:g} N m{changed}."


def _loads(part: RunPart) -> dict[str, Value]:
    """Cells of loads; shares refer to the limits in force when the part began."""
    peak_N, peak_Nm = _force_and_moment(part.peak)
    expected_N, expected_Nm = _force_and_moment(part.expected)
    limits: Mapping[str, float] = {}
    if part.begun:
        limits = part.begun.limits
    return {
        "peak_force_N": peak_N,
        "expected_force_N": expected_N,
        "force_of_limit_pct": _percent_of_limit(peak_N, limits.get("force_N")),
        "peak_moment_Nm": peak_Nm,
        "expected_moment_Nm": expected_Nm,
        "moment_of_limit_pct": _percent_of_limit(peak_Nm, limits.get("torque_Nm")),
    }


def _force_and_moment(load: Load | None) -> tuple[float | None, float | None]:
    if load is None:
        return None, None
    return load.force_N, load.torque_Nm


def _percent_of_limit(value: float | None, limit: float | None) -> float | None:
    if value is None or not limit:
        return None
    return 100.0 * value / limit


def conditions_table(story: RunStory) -> Table:
    """A row for each condition: number planned, number done, and scatter of the peaks."""
    planned = _plan_counts(story)
    # Of what was cut short only cycles count as done, as many as were recorded.
    done = [part for part in story.parts if part.kind != "cut short" or part.count > 1]
    rows = []
    for key in dict.fromkeys([*planned, *(_key(part) for part in done)]):
        of_key = [part for part in done if _key(part) == key]
        rows.append(_condition_row(key, planned.get(key), of_key))
    columns = [TableColumn("kind", "What"), TableColumn("condition", "Condition")]
    if planned:
        columns.append(TableColumn("planned", "Planned"))
    columns += [
        TableColumn("done", "Done"),
        TableColumn(
            "mean_peak_force_N", "mean", digits=2, half="std_peak_force_N", over="Peak force"
        ),
        TableColumn("std_peak_force_N", role="kept"),
        TableColumn("largest_peak_force_N", "largest", digits=1, over="Peak force"),
        TableColumn("expected_force_N", "expected", digits=1, over="Peak force"),
    ]
    caption = (
        "Peaks of all axes: mean ± one standard deviation (n - 1) over what was done; of "
        "static stages, whose angles differ, the largest."
    )
    return Table("conditions", caption, tuple(columns), tuple(rows))


def _key(part: RunPart) -> tuple[str, str]:
    if part.kind == "cut short":
        return "cycles", part.label.partition(", ")[2]
    return part.kind, part.condition


def _plan_counts(story: RunStory) -> dict[tuple[str, str], int]:
    if story.plan is None:
        return {}
    counts: dict[tuple[str, str], int] = {}
    strokes = [
        ("stroke", f"{1e3 * s.height_m:g} mm, {s.speed_rad_s:g} rad/s", 1) for s in story.plan.flaps
    ]
    holds = [("static stage", f"{1e3 * s.height_m:g} mm", 1) for s in story.plan.holds]
    cycles = [("cycles", s.label.partition(", ")[2], s.count) for s in cycles_in(story.plan)]
    for kind, condition, count in (*strokes, *holds, *cycles):
        counts[kind, condition] = counts.get((kind, condition), 0) + count
    return counts


def _condition_row(key: tuple[str, str], planned: int | None, parts: Sequence[RunPart]) -> TableRow:
    peaks = [part.peak.force_N for part in parts if part.peak is not None]
    count = sum(part.count for part in parts)
    values: dict[str, Value] = {
        "kind": key[0],
        "condition": key[1],
        "planned": planned,
        "done": count,
    }
    values["largest_peak_force_N"] = max(peaks, default=None)
    values["expected_force_N"] = max(
        (part.expected.force_N for part in parts if part.expected is not None), default=None
    )
    # Static stages of one height have different angles: their mean peak would mean nothing.
    if peaks and key[0] != "static stage":
        std = None
        if len(peaks) > 1:
            std = float(np.std(peaks, ddof=1))
        values |= {"mean_peak_force_N": float(np.mean(peaks)), "std_peak_force_N": std}
    return TableRow(values, marked=planned is not None and count < planned)


def clocks_table(recording: Recording) -> Table:
    """Clock drift of each device relative to the host."""
    rows = tuple(
        TableRow(
            {
                "device": d.device,
                "drift_ppm": d.ppm,
                "half_ppm": d.half_ppm,
                "span_s": d.span_s,
                "blocks": d.blocks,
            }
        )
        for d in clock_drifts(recording)
    )
    columns = (
        TableColumn("device", "Device"),
        TableColumn("drift_ppm", "Gains on the host", digits=1, half="half_ppm"),
        TableColumn("half_ppm", role="kept"),
        TableColumn("span_s", "Over", digits=1),
        TableColumn("blocks", "Blocks"),
    )
    caption = (
        "Slope of device time over host time, from the sample of every quarter of a "
        "second that was under way shortest; ± is the most that "
        "uneven arrival can feign."
    )
    return Table("clocks", caption, columns, rows)


def events_table(events: Sequence[Mapping[str, Any]]) -> Table:
    """Events other than those that every run has."""
    rows = tuple(TableRow(_event(event)) for event in events if event["event"] not in ORDINARY)
    columns = (
        TableColumn("t_s", "At", digits=2),
        TableColumn("event", "Event"),
        TableColumn("about", "What of it"),
    )
    return Table(
        "events", "By the rig's clock, which begins with the run.", columns, rows[:MOST_ROWS]
    )


def _event(event: Mapping[str, Any]) -> dict[str, Value]:
    about = {name: value for name, value in event.items() if name not in SHOWN_ELSEWHERE}
    text = "; ".join(f"{name.replace('_', ' ')} {_plain(value)}" for name, value in about.items())
    return {"t_s": event.get("t_s"), "event": event["event"], "about": text}


def _plain(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name.replace('_', ' ')} {_plain(item)}" for name, item in value.items())
    return str(value)


def checks_table(story: RunStory) -> Table:
    """Drift of the stiffness since the first check of a fatigue run; no rows for other runs."""
    if story.plan:
        checks = [stage for stage in story.plan.stages if isinstance(stage, StiffnessCheck)]
    else:
        checks = []
    before = _cycles_before(story)
    drifts = [
        (check, stiffness_drift(story.recording.static, check.holds, check.number))
        for check in checks
        if check.number > 1
    ]
    rows = tuple(
        TableRow(
            {
                "check": check.number,
                "cycles": before.get(check.number),
                "drift_pct": 100.0 * drift.relative,
                "half_pct": 100.0 * STDS_OF_95 * drift.std,
                "limit_pct": 100.0 * check.drift_limit,
            },
            marked=abs(drift.relative) > check.drift_limit,
        )
        for check, drift in drifts
        if drift is not None
    )
    columns = (
        TableColumn("check", "Check"),
        TableColumn("cycles", "Cycles before it"),
        TableColumn("drift_pct", "Drift of the forces", half="half_pct"),
        TableColumn("half_pct", role="kept"),
        TableColumn("limit_pct", "Limit ±", set_value=True),
    )
    caption = (
        "Change of the forces at the same shaft angles since the first check, ± half of a 95 "
        "% interval from what one factor leaves over."
    )
    return Table("stiffness-checks", caption, columns, rows)


def _cycles_before(story: RunStory) -> dict[int, int]:
    """Planned number of cycles before each check by its number; a single stroke counts as a
    cycle.
    """
    counts: dict[int, int] = {}
    if not story.plan:
        return counts
    turned = 0
    for stage in story.plan.stages:
        match stage:
            case StiffnessCheck():
                counts[stage.number] = turned
            case Cycles():
                turned += stage.count
            case Flap():
                turned += 1
    return counts
