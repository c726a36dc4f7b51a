"""run.html: one self-contained page on how a run went, as a list of its sections, with its health
in words.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import degrees
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
from markupsafe import Markup

from rfca_rig.engine.stages import HOLD_PERIOD_S, MOVE_TICK_S, TICK_S
from rfca_rig.errors import TRIP
from rfca_rig.recording.loop_gaps import recorded_gaps
from rfca_rig.recording.model import Recording
from rfca_rig.reports.elements import (
    EMPTY,
    aside,
    code,
    figure,
    folded,
    html,
    join,
    legend,
    legend_dot,
    legend_line,
    mark,
    page_links,
    pairs,
    panels,
    paragraph,
    verdict,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.provenance import PageContext, date_text
from rfca_rig.reports.run import pictures
from rfca_rig.reports.run.parts import RunStory
from rfca_rig.reports.run.tables import (
    MOST_ROWS,
    checks_table,
    clocks_table,
    conditions_table,
    events_table,
    stages_table,
)
from rfca_rig.reports.sections import PageSection, SideBySide
from rfca_rig.reports.table import Table
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import count_noun, in_thousands, keep_units_together, number

Pairs = list[tuple[str, str]]

# Longer texts of the provenance are shown as length and hash.
LONGEST_TEXT = 160
DEVICES = ("motor_", "sensor_", "camera")
HEALTH = ("sensor_records", "tare_drift")  # begin like a device, and say how the run went
# Keys that another part of the page shows.
SHOWN_ELSEWHERE = (
    "events",
    "limits",
    "resumed",
    "started_at",
    "ended",
    "exit_status",
    "reason",
    "ended_at",
    "lasted_s",
    "worst_loop_gap_ms",
    "loop_gaps_ms",
    "ended_in_stage",
    "standstill",
    "tare_drift",
    "sensor_records",
    "recorder_samples",
    "bad_samples",
    "interrupted",
)

DONE = "done"
LISTENED = "Recorded without motion: the motor was neither enabled nor commanded by this program."
# Stiffness checks that the page lists; the CSV has all.
MOST_CHECKS = 20
# Key of a limit, words, unit shown, factor to that unit.
LIMIT_WORDS = (
    ("force_N", "force", "N", 1.0),
    ("torque_Nm", "moment", "N m", 1.0),
    ("speed_rad_s", "speed of the shaft", "rad/s", 1.0),
    ("following_error_rad", "following error", "deg", degrees(1.0)),
    ("above_expected", "load over the expected", "times", 1.0),
    ("above_expected_s", "such a load for", "ms", 1e3),
    ("temperature_C", "temperature of the drive", "°C", 1.0),
    ("sensor_silent_s", "sensor silent for", "ms", 1e3),
    ("drive_silent_s", "drive silent for", "ms", 1e3),
    ("late_s", "control loop late by", "ms", 1e3),
)


def page(
    story: RunStory, tables: Sequence[Table], context: PageContext, files: Sequence[str]
) -> str:
    """The page as HTML.

    Parameters
    ----------
    story
        The run.
    tables
        Stages, conditions and stiffness checks, from `tables_of`.
    context
        Origin of the page and links to others.
    files
        Names of the files beside the page, which it links.
    """
    recording = story.recording
    stages, conditions, checks = tables
    share = _share(story, conditions)
    sections = [
        _conditions(conditions, is_planned=share is not None),
        _health_and_limits(story),
        _loop_gaps(story),
        _over_the_cycles(story),
        _stiffness(checks),
        _strokes(story),
        _static_stages(recording),
        _stage_by_stage(stages, files),
        _events(story),
        _devices(recording),
    ]
    return render_page(
        f"{recording.title}: the run",
        _opening(story, share, context),
        sections,
        context.origin,
        files,
        sheets=("verdict.css",),
        closing=_closing(recording),
    )


def _opening(story: RunStory, share: tuple[str, str] | None, context: PageContext) -> Markup:
    recording = story.recording
    title = html("How the run went: {} {}", recording.title, mark(recording.source))
    css, stamp = _stamp(story)
    number, number_words = share or ("", "")
    stated = verdict(css, stamp, _sentence(story), _loads_sentence(story), number, number_words)
    return join("\n", [paragraph(title, "of"), stated, page_links(context.links)])


def _conditions(conditions: Table, is_planned: bool) -> PageSection:
    if is_planned:
        title = "What was planned, what was done"
    else:
        title = "What was recorded"
    return PageSection(title, [as_html(conditions)])


def _health_and_limits(story: RunStory) -> SideBySide | None:
    texts = [(name, keep_units_together(text)) for name, text in health(story)]
    if not texts:
        return None
    limits_section = None
    if limits := _limits(story):
        limits_section = PageSection("Limits in force", [pairs(limits)])
    return SideBySide(
        "sides",
        [
            [PageSection("How it went", [pairs(texts)])],
            # Without limits their column stays free.
            [limits_section],
        ],
    )


def _loop_gaps(story: RunStory) -> PageSection | None:
    gaps = recorded_gaps(story.recording.provenance)
    if gaps is None:
        return None
    late_s = story.last_limits.get("late_s")
    caption = (
        "Time between two ticks, each counted once, on logarithmic scales. The loop ticks every "
        f"{1e3 * TICK_S:g} ms in a stroke, every {1e3 * MOVE_TICK_S:g} ms in moves and cycles, and "
        f"every {1e3 * HOLD_PERIOD_S:g} ms where the shaft is held."
    )
    lines = [legend_line("var(--measured)", 5, "ticks")]
    late_ms = None
    if late_s is not None:
        late_ms = (1e3 * (late_s + TICK_S), 1e3 * (late_s + HOLD_PERIOD_S))
        caption += (
            f" A tick that comes more than {1e3 * late_s:g} ms late ends the run: a gap of "
            f"{late_ms[0]:g} to {late_ms[1]:g} ms."
        )
        lines.append(legend_line("var(--simulated)", 5, "the loop is too late"))
    if gaps.watchdog_ms is not None:
        lines.append(legend_line("var(--bad)", 1.4, "the drive removes its torque"))
    drawn = figure("", pictures.draw_gaps(pictures.GapPicture(gaps, late_ms)), caption)
    return PageSection(
        "Gaps of the control loop", [paragraph(f"{gaps.text()}."), legend(*lines), drawn]
    )


def _over_the_cycles(story: RunStory) -> PageSection | None:
    if not pictures.has_cycles(story.recording):
        return None
    colours = legend(
        legend_line("var(--measured)", 1.2, "largest force of a cycle, all axes"),
        legend_line("var(--measured)", 1.2, "least fz of a cycle", "5 3"),
        legend_line("var(--simulated)", 3, "largest force that the model expects"),
    )
    counts = [part.count for part in story.parts if part.label.startswith("cycles ")]
    caption = (
        f"{count_noun(sum(counts), 'cycle')}, each measured once; where there are more than the "
        "picture has columns, the least and the largest of each column."
    )
    drawn = figure("Force", pictures.draw_cycles(story), caption)
    return PageSection("Over the cycles", [colours, drawn])


def _stiffness(checks: Table) -> PageSection | None:
    """Stiffness checks of a fatigue run, which belong to its cycles."""
    if not checks.rows:
        return None
    caption = (
        "Change of the forces at the same shaft angles since the first check; bars are 95 % "
        "intervals, dashed the limits that end the run."
    )
    shown = _thin_out(checks)
    contents = [figure("Stiffness", pictures.draw_checks(checks), caption), as_html(shown)]
    if len(checks.rows) > len(shown.rows):
        count = f"{len(shown.rows)} of {len(checks.rows)} checks"
        contents.append(aside(f"{count}; all are in the CSV beside this page."))
    return PageSection("", contents)


def _strokes(story: RunStory) -> PageSection | None:
    shown = pictures.select_traces(story.parts)
    traces = pictures.draw_traces(shown, story.rig)
    if not traces:
        return None
    count = _of(len(shown), sum(part.trace is not None for part in story.parts), "stroke")
    caption = (
        f"{count}, each measured once, on one scale. Expected: the nominal model, with the shaft "
        "as commanded."
    )
    colours = legend(
        legend_line("var(--measured)", 1, "measured"),
        legend_line("var(--simulated)", 3.5, "expected"),
    )
    title = "fz over time from the start of the motion"
    return PageSection("Strokes", [colours, panels(title, traces, caption, "many")])


def _static_stages(recording: Recording) -> PageSection | None:
    shown = pictures.select_static_stages(recording.static)
    if not shown:
        return None
    count = _of(len(shown), len(recording.static), "stage")
    caption = (
        f"{count}: means after settling; bars are one standard deviation of a single sample. "
        "Lines join the stages of a height, the lowest height unbroken. The numbers stand in the "
        "page beside this one."
    )
    colours = legend(
        legend_dot("var(--measured)", "var(--measured)", 3, "loading"),
        legend_dot("var(--measured)", "var(--paper)", 3, "unloading"),
    )
    drawn = pictures.draw_static_forces(shown)
    title = "Forces over the shaft\u2019s angle"
    return PageSection("Static stages", [colours, panels(title, drawn, caption, "many")])


def _stage_by_stage(stages: Table, files: Sequence[str]) -> PageSection | None:
    if not stages.rows:
        return None
    # The first rows, and all marked ones: stages that were cut short.
    rows = tuple(row for index, row in enumerate(stages.rows) if index < MOST_ROWS or row.marked)
    contents = [as_html(replace(stages, rows=rows), "dense")]
    if len(stages.rows) > MOST_ROWS:
        file = next((name for name in files if name.endswith("-stages.csv")), "")
        contents.append(
            aside(html("The first {} rows; all are in {}.", str(len(rows)), code(file)))
        )
    return PageSection("Stage by stage", contents)


def _events(story: RunStory) -> PageSection | None:
    events = events_table(story.events)
    if not events.rows:
        return None
    return PageSection("What happened", [as_html(events, "dense")])


def _devices(recording: Recording) -> PageSection | None:
    clocks = clocks_table(recording)
    reported = devices(recording.provenance)
    contents = []
    if clocks.rows:
        contents.append(as_html(clocks))
    if reported:
        contents.append(pairs(reported, "small columns"))
    if contents:
        return PageSection("Who measured", contents)
    return None


def _closing(recording: Recording) -> Markup:
    known = provenance(recording.provenance)
    if not known:
        return EMPTY
    return folded("Everything that the run states of itself", pairs(known, "small columns"))


def health(story: RunStory) -> Pairs:
    """Health of a run: pairs of name and text, with the limit where there is one."""
    known = story.recording.provenance
    times = json.loads(known.get("resumed", "[]"))
    lasted = ""
    if "lasted_s" in known:
        lasted = f"{float(known['lasted_s']):.1f} s"
    texts = {
        "ended": _end_text(known),
        "in or after": known.get("ended_in_stage", ""),
        "began": date_text(known.get("started_at", "")),
        "lasted": lasted,
        "shaft, once the torque was gone": known.get("standstill", ""),
        "longest gap of the control loop": _gap(story),
        "records of the sensor": known.get("sensor_records", ""),
        "reports of the drive with impossible numbers": known.get("motor_bad_reports", ""),
        "samples that were no numbers": known.get("bad_samples", ""),
        "samples to the recorder": known.get("recorder_samples", ""),
        "drift of the sensor\u2019s zero": known.get("tare_drift", ""),
        "zero of the sensor at rest": _tares(story.events),
        "went on": "; ".join(
            f"at {event['utc']}{_changes_text(event)}, had stopped: {event['stopped']}"
            for event in times
        ),
    }
    return [(name, text) for name, text in texts.items() if text]


def _end_text(known: Mapping[str, str]) -> str:
    if "ended" not in known:
        return known.get("interrupted", "")
    return (
        f"{known['ended']} (exit status {known.get('exit_status', '?')}, reason "
        f"{known.get('reason', '?')})"
    )


def _gap(story: RunStory) -> str:
    gap_ms = story.recording.provenance.get("worst_loop_gap_ms", "")
    late_s = story.limits.get("late_s")
    if not gap_ms:
        return ""
    text = f"{float(gap_ms):.1f} ms"
    if late_s:
        text += f", may be late by {1e3 * late_s:g} ms"
    return text


def _tares(events: Sequence[Mapping[str, Any]]) -> str:
    """Mean and standard deviation of fz over all rests in the air."""
    fz_N = [float(event["fz_N"]) for event in events if event["event"] == "tare"]
    if not fz_N:
        return ""
    if len(fz_N) > 1:
        spread = f" ± {np.std(fz_N, ddof=1):.3f}"
    else:
        spread = ""
    return (
        f"fz {number(float(np.mean(fz_N)), 3)}{spread} N, mean and standard deviation over "
        f"{count_noun(len(fz_N), 'rest')} in the air"
    )


def _changes_text(event: Mapping[str, Any]) -> str:
    changes = ", ".join(
        f"{name} {shorten(str(value))}" for name, value in event.get("rig_changes", {}).items()
    )
    if changes:
        return f" with {changes}"
    return ""


def devices(kept: Mapping[str, str]) -> Pairs:
    """What the devices reported of themselves: pairs of name and text."""
    facts = {
        name: text
        for name, text in kept.items()
        if name not in SHOWN_ELSEWHERE and not name.startswith("camera_file")
    }
    return [
        (_words(name), shorten(text))
        for name, text in sorted(facts.items())
        if name.startswith(DEVICES)
    ]


def provenance(kept: Mapping[str, str]) -> Pairs:
    """Provenance that no other part of the page shows: pairs of name and text."""
    return [
        (_words(n), shorten(text))
        for n, text in sorted(kept.items())
        if not n.startswith(DEVICES) and n not in SHOWN_ELSEWHERE
    ]


def _words(name: str) -> str:
    return name.replace("_", " ")


def shorten(text: str) -> str:
    """Short text unchanged, but only the last part of an absolute path; length and hash of a
    long text.
    """
    if len(text) > LONGEST_TEXT or "\n" in text.strip():
        return (
            f"text of {count_noun(len(text.splitlines()), 'line')}, sha256 "
            f"{hashlib.sha256(text.encode()).hexdigest()[:16]}…"
        )
    # Both kinds: a recording may come from another system. PureWindowsPath also splits at "/".
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return PureWindowsPath(text).name
    return text


def tables_of(story: RunStory) -> tuple[Table, Table, Table]:
    """Tables that are also written as CSV and LaTeX: stages, conditions, stiffness checks."""
    return stages_table(story), conditions_table(story), checks_table(story)


def _limits(story: RunStory) -> list[tuple[str, str]]:
    """Limits of the run; one that changed when the run was resumed has both values."""
    lines = []
    for key, words, unit, factor in LIMIT_WORDS:
        if key in story.limits:
            first, last = (
                f"{factor * limits[key]:.4g} {unit}" for limits in (story.limits, story.last_limits)
            )
            text = first
            if last != first:
                text += f", later {last}"
            lines.append((words, text))
    return lines


def _thin_out(checks: Table) -> Table:
    """Evenly chosen checks with the first and the last, and all beyond the limit."""
    count = len(checks.rows)
    if count > MOST_CHECKS:
        chosen = {round(part * (count - 1) / (MOST_CHECKS - 1)) for part in range(MOST_CHECKS)}
    else:
        chosen = set(range(count))
    return replace(
        checks,
        rows=tuple(row for index, row in enumerate(checks.rows) if index in chosen or row.marked),
    )


def _stamp(story: RunStory) -> tuple[str, str]:
    """Class of the style sheet and text of the stamp: done, a trip's code, stopped, imported."""
    known: Mapping[str, str] = story.recording.provenance
    reason = known.get("reason", "")
    if story.recording.source == "IMPORT":
        return "not", "imported"
    if reason == DONE:
        return "named", DONE
    if _has_tripped(known):
        return "unexplained", f"tripped {reason}"
    return "unexplained", reason.replace("-", " ") or "not ended"


def _sentence(story: RunStory) -> str:
    known = story.recording.provenance
    ended = known.get("ended", "")
    interrupted = known.get("interrupted", "")
    if story.recording.source == "IMPORT":
        return "Recorded elsewhere: what was not imported is not shown here."
    if story.recording.is_listening:
        return f"{LISTENED} {_sentence_on_end(ended or interrupted)}"
    if ended == DONE:
        return "The whole plan was carried out."
    if not ended and interrupted:
        return keep_units_together(f"{interrupted[:1].upper()}{interrupted[1:]}.")
    if not ended:
        return "The run was never brought to its end."
    if _has_tripped(known):
        explained = (
            f" What {known['reason']} means, and what to do: rfca-rig trip {known['reason']}."
        )
    else:
        explained = ""
    return keep_units_together(f"The run ended before its plan did: {ended}.{explained}")


def _sentence_on_end(why: str) -> str:
    if why == DONE:
        return "The recording is complete."
    return keep_units_together(f"It ended early: {why or 'its end is not on record'}.")


def _has_tripped(kept: Mapping[str, str]) -> bool:
    return kept.get("ended", "").startswith(TRIP)


def _share(story: RunStory, done: Table) -> tuple[str, str] | None:
    """Share of the plan that was done, and what it counts; None without a plan."""
    planned = sum(
        int(str(row.values["planned"]))
        for row in done.rows
        if row.values.get("planned") is not None
    )
    if not planned:
        return None
    count = sum(int(str(row.values["done"])) for row in done.rows)
    counted = "parts"
    if story.plan:
        words = {"dynamic": "strokes", "static": "static stages", "fatigue": "cycles and stages"}
        counted = words[story.plan.experiment]
    share = f"{in_thousands(str(count))} of {in_thousands(str(planned))}"
    return share, f"{counted} recorded"


def _loads_sentence(story: RunStory) -> str:
    peaks = [(part.peak, part) for part in story.parts if part.peak is not None]
    if not peaks:
        return "No force was recorded."
    peak, part = max(peaks, key=lambda pair: pair[0].force_N)
    limit = None
    if part.begun:
        limit = part.begun.limits.get("force_N")
    sentence = f"The largest force was {peak.force_N:.1f} N, in {part.label}"
    if limit:
        sentence += f", {100.0 * peak.force_N / limit:.0f} % of the limit of {limit:g} N"
    if part.expected:
        sentence += f"; the model expected {part.expected.force_N:.1f} N there"
    return keep_units_together(f"{sentence}.")


def _of(shown: int, of: int, what: str) -> str:
    """Number of items, and how many of them are shown where that is not all."""
    if shown == of:
        return count_noun(of, what)
    return f"{shown} of {count_noun(of, what)}, evenly over the run"
