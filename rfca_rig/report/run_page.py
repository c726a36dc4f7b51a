"""run.html: one self-contained page on how a run went."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rfca_rig.errors import TRIP
from rfca_rig.report import run_pictures
from rfca_rig.report.provenance import PageContext
from rfca_rig.report.run_health import devices, health, provenance
from rfca_rig.report.run_parts import RunStory
from rfca_rig.report.run_tables import MOST_ROWS, checks_table, clocks_table, conditions_table, events_table, stages_table
from rfca_rig.report.table import Table
from rfca_rig.report.templates import template
from rfca_rig.report.text import count_noun, in_thousands, keep_units_together

DONE = "done"
# Stiffness checks that the page lists; the CSV has all.
MOST_CHECKS = 20
# Key of a limit, words, unit shown, factor to that unit.
LIMIT_WORDS = (
    ("force_N", "force", "N", 1.0),
    ("torque_Nm", "moment", "N m", 1.0),
    ("speed_rad_s", "speed of the shaft", "rad/s", 1.0),
    ("following_error_rad", "following error", "rad", 1.0),
    ("above_expected", "load over the expected", "times", 1.0),
    ("above_expected_s", "such a load for", "ms", 1e3),
    ("temperature_C", "temperature of the drive", "°C", 1.0),
    ("sensor_silent_s", "sensor silent for", "ms", 1e3),
    ("drive_silent_s", "drive silent for", "ms", 1e3),
    ("late_s", "control loop late by", "ms", 1e3),
)


def page(story: RunStory, tables: Sequence[Table], told: PageContext, files: Sequence[str]) -> str:
    """The page as HTML.

    Parameters
    ----------
    story
        The run.
    tables
        Stages, conditions and stiffness checks, from `tables_of`.
    told
        Origin of the page and links to others.
    files
        Names of the files beside the page, which it links.
    """
    recording, known = story.recording, story.recording.provenance
    stages, done, checks = tables
    shown, stages_shown = run_pictures.select_traces(story.parts), run_pictures.select_static_stages(recording.static)
    return template("run.html").render(
        sheets=("verdict.css",),
        origin=told.origin,
        links=told.links,
        files=files,
        title=recording.title,
        mark=recording.source,
        stamp=_stamp(story),
        sentence=_sentence(story),
        loads=_loads_sentence(story),
        share=_share(story, done),
        done=done,
        limits=_limits(story),
        health=[(name, keep_units_together(text)) for name, text in health(story)],
        stages=_first_and_marked(stages),
        stages_file=next((name for name in files if name.endswith("-stages.csv")), ""),
        left_out=max(len(stages.rows) - MOST_ROWS, 0),
        traces=run_pictures.draw_traces(shown, story.rig) if shown else "",
        traced=_traces_caption(len(shown), sum(part.trace is not None for part in story.parts)),
        static=run_pictures.draw_static_forces(stages_shown) if stages_shown else "",
        static_count=_of(len(stages_shown), len(recording.static), "stage"),
        cycles=run_pictures.draw_cycles(story) if run_pictures.has_cycles(recording) else "",
        cycle_count=count_noun(sum(part.count for part in story.parts if part.label.startswith("cycles ")), "cycle"),
        checks=_thin_out(checks),
        check_count=len(checks.rows),
        check_picture=run_pictures.draw_checks(checks) if checks.rows else "",
        clocks=clocks_table(recording),
        events=events_table(story.events),
        devices=devices(known),
        provenance=provenance(known),
    )


def tables_of(story: RunStory) -> tuple[Table, Table, Table]:
    """Tables that are also written as CSV and LaTeX: stages, conditions, stiffness checks."""
    return stages_table(story), conditions_table(story), checks_table(story)


def _limits(story: RunStory) -> list[tuple[str, str]]:
    """Limits of the run; one that changed when the run was resumed has both values."""
    lines = []
    for key, words, unit, factor in LIMIT_WORDS:
        if key in story.limits:
            first, last = (f"{factor * limits[key]:.4g} {unit}" for limits in (story.limits, story.last_limits))
            lines.append((words, first if first == last else f"{first}, later {last}"))
    return lines


def _first_and_marked(stages: Table) -> Table:
    """The first rows, and all marked ones: stages that were cut short."""
    rows = tuple(row for place, row in enumerate(stages.rows) if place < MOST_ROWS or row.marked)
    return Table(stages.name, stages.caption, stages.columns, rows)


def _thin_out(checks: Table) -> Table:
    """Evenly chosen checks with the first and the last, and all beyond the limit."""
    count = len(checks.rows)
    chosen = {round(part * (count - 1) / (MOST_CHECKS - 1)) for part in range(MOST_CHECKS)} if count > MOST_CHECKS else set(range(count))
    return replace(checks, rows=tuple(row for place, row in enumerate(checks.rows) if place in chosen or row.marked))


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
    ended, interrupted = known.get("ended", ""), known.get("interrupted", "")
    if story.recording.source == "IMPORT":
        return "Recorded elsewhere: what was not imported is not told here."
    if ended == DONE:
        return "The whole plan was carried out."
    if not ended:
        return keep_units_together(
            f"{interrupted[:1].upper()}{interrupted[1:]}." if interrupted else "The run was never brought to its end."
        )
    explained = f" What {known['reason']} means, and what to do: rfca-rig trip {known['reason']}." if _has_tripped(known) else ""
    return keep_units_together(f"The run ended before its plan did: {ended}.{explained}")


def _has_tripped(kept: Mapping[str, str]) -> bool:
    return kept.get("ended", "").startswith(TRIP)


def _share(story: RunStory, done: Table) -> dict[str, str] | None:
    """Share of the plan that was done; None without a plan."""
    planned = sum(int(str(row.values["planned"])) for row in done.rows if row.values.get("planned") is not None)
    if not planned:
        return None
    count = sum(int(str(row.values["done"])) for row in done.rows)
    words = {"dynamic": "strokes", "static": "static stages", "fatigue": "cycles and stages"}
    return {
        "count": f"{in_thousands(str(count))} of {in_thousands(str(planned))}",
        "of": f"{words[story.plan.experiment] if story.plan else 'parts'} recorded",
    }


def _loads_sentence(story: RunStory) -> str:
    peaks = [(part.peak, part) for part in story.parts if part.peak is not None]
    if not peaks:
        return "No force was recorded."
    peak, part = max(peaks, key=lambda each: each[0].force_N)
    limit, expected = part.begun.limits.get("force_N") if part.begun else None, part.expected
    sentence = f"The largest force was {peak.force_N:.1f} N, in {part.label}"
    sentence += f", {100.0 * peak.force_N / limit:.0f} % of the limit of {limit:g} N" if limit else ""
    sentence += f"; the model expected {expected.force_N:.1f} N there" if expected else ""
    return keep_units_together(f"{sentence}.")


def _traces_caption(shown: int, of: int) -> str:
    strokes = _of(shown, of, "stroke")
    return f"{strokes}, each measured once, on one scale. Expected: the model as it was believed, with the shaft as commanded."


def _of(shown: int, of: int, what: str) -> str:
    """Number of items, and how many of them are shown where that is not all."""
    return count_noun(of, what) if shown == of else f"{shown} of {count_noun(of, what)}, evenly over the run"
