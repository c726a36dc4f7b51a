"""The page about a run: whole, tripped, worn out, imported."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.reports.provenance import Origin, PageContext, PageLink, RecordingSource
from rfca_rig.reports.run.page import page, tables_of
from rfca_rig.reports.run.parts import story_of
from rfca_rig.reports.run.pictures import (
    MOST_STAGES,
    MOST_TRACES,
    select_static_stages,
    select_traces,
)
from rfca_rig.reports.run.tables import MOST_ROWS, clock_drifts
from rfca_rig.reports.table import as_csv
from tests.report import runs
from tests.report.outline import Outline
from tests.report.recordings import recording, stages, strokes


def shown(recorded):
    story = story_of(recorded)
    told = PageContext(
        Origin("", (RecordingSource(recorded.source, recorded.title),)),
        (PageLink("report.html", "Compared with the model"),),
    )
    html = page(story, tables_of(story), told, ("run-stages.csv",))
    outline = Outline(html)
    assert len(outline.ids) == len(set(outline.ids))
    assert not any(word in outline.text for word in ("nan", "None", "inf "))
    assert all(each.startswith("#") or each == "report.html" for each in outline.fetched)
    assert "A <run>" not in html
    return html, " ".join(outline.text.replace("\u00a0", " ").split()), story


def rows(table):
    return list(csv.DictReader(io.StringIO(as_csv(table))))


def test_a_run_that_was_carried_out():
    html, text, story = shown(runs.done())
    assert (
        "done" in text
        and "The whole plan was carried out." in text
        and "4 of 4 strokes recorded" in text.replace("4strokes", "4 strokes")
    )
    for said in (
        "12.5 ms, may be late by 50 ms",
        "7 lost",
        "turned by 11.1 deg",
        "0.100 N, 0.0000 N m from the first rest",
        "fz 3.150 ± 0.071 N, mean and standard deviation over 2 rests",
        "ODrive, CANSimple",
        "FT-31415",
        "text of 3 lines",
        "exit status 0, reason done",
        "Limits 300 N and 25 N m",
    ):
        assert said in text, said
    assert html.count('role="img"') == 4 and html.count("<h4>215 mm, 2.433 rad/s, no. ") == 2
    first = rows(tables_of(story)[0])[0]
    measured = story.recording.strokes[0]
    fz_N, fy_N = (measured.channel(name) for name in ("fz_N", "fy_N"))
    peak = float(np.sqrt(fz_N[1] ** 2 + (0.0 if fy_N is None else fy_N[1] ** 2)).max())
    assert float(first["peak_force_N"]) == pytest.approx(peak)
    assert float(first["force_of_limit_pct"]) == pytest.approx(100.0 * peak / 300.0)
    assert float(first["expected_force_N"]) > 50.0 and first["begun_s"] == "1.0"


def test_the_gaps_of_the_loop_are_shown_where_they_were_counted():
    plain = runs.done()
    assert "Gaps of the control loop" not in shown(plain)[1]
    counted = {"loop_gaps_ms": '{"1.995": 9990, "2.371": 9, "11.89": 1}', "watchdog_ms": "100"}
    html, text, _ = shown(replace(plain, provenance={**plain.provenance, **counted}))
    assert "99.9 % of 10000 ticks within 2.1 ms; longest 12.5 ms; the watchdog is 100 ms." in text
    assert "A tick that comes more than 50 ms late ends the run: a gap of 52 to 60 ms." in text
    assert html.count('aria-label="ticks over their gaps') == 2
    assert "loop gaps ms" not in text


def test_a_run_that_tripped_says_so_first_and_shows_what_was_cut_short():
    html, text, story = shown(runs.tripped())
    assert "What L-01 means, and what to do: rfca-rig trip L-01." in text
    assert "tripped L-01" in text and "1 of 4" in text and 'class="mark REAL"' in html
    assert text.index("TRIP L-01: force 50.5 N, limit 50 N") < text.index("What was planned")
    assert "cut short: TRIP L-01" in text and "✗" in html
    stage = rows(tables_of(story)[0])[1]
    assert float(stage["peak_force_N"]) == 50.5 and stage["cut_short"].startswith("cut short: TRIP")
    assert [
        (row["done"], each.marked)
        for row, each in zip(rows(tables_of(story)[1]), tables_of(story)[1].rows, strict=True)
    ] == [
        ("1", True),
        ("0", True),
    ]
    assert text.count("motor off") == 1


def test_a_worn_leg_shows_its_cycles_and_its_checks():
    html, text, story = shown(runs.worn())
    _, done, checks = tables_of(story)
    (check,) = rows(checks)
    assert float(check["drift_pct"]) == pytest.approx(-8.0, abs=0.3) and check["cycles"] == "40"
    assert checks.rows[0].marked and "worn out" in text
    by_kind = {row["kind"]: row for row in rows(done)}
    assert (
        by_kind["cycles"]["done"],
        by_kind["cycles"]["planned"],
        by_kind["static stage"]["done"],
    ) == ("40", "40", "6")
    assert float(by_kind["cycles"]["largest_peak_force_N"]) == pytest.approx(51.0)
    assert float(by_kind["cycles"]["expected_force_N"]) > 30.0
    # The static forces are three panels; cycles and checks are drawn for two widths.
    assert html.count('role="img"') == 7 and "40 cycles, each measured once" in text


def test_a_campaign_from_elsewhere_tells_what_it_holds():
    html, text, story = shown(recording(strokes(), stages()))
    assert "imported" in text and "Planned" not in text and "Limits in force" not in text
    assert (
        "No limits are recorded" in text
        and html.count('role="img"') == len(story.recording.strokes) + 3
    )
    assert all(float(row["expected_force_N"]) > 30.0 for row in rows(tables_of(story)[0])[:4])


def test_a_recording_that_believes_nothing_has_no_expectation():
    nothing = replace(recording(static=stages()), nominal={})
    _, text, story = shown(nothing)
    assert "No force was recorded" in text and story.rig is None


def test_a_plan_of_another_version_is_done_without():
    other = runs.done()
    plan = json.dumps([{"stage": "Dance", "label": "?"}])
    _, text, story = shown(replace(other, provenance={**other.provenance, "plan": plan}))
    assert story.plan is None and "plan text" not in text and "of 4" not in text


@pytest.mark.slow
def test_long_runs_stay_light():
    base = runs.done()
    many = tuple(replace(base.strokes[0], repeat=number) for number in range(1, 91))
    html, text, story = shown(replace(base, strokes=many))
    assert len(select_traces(story.parts)) == MOST_TRACES and f"{MOST_TRACES} of 90 strokes" in text
    assert f"The first {MOST_ROWS} rows" in text and len(rows(tables_of(story)[0])) == 90
    # 40 panels, each with its own axis and 12 values for a pointer.
    assert len(html.encode()) < 300_000


def test_long_runs_show_whole_sequences_of_static_stages():
    many = tuple(runs.static_stage(n, runs.CHECKED_DEG[n % 3], -10.0) for n in range(300))
    shown_stages = select_static_stages(many)
    assert len(shown_stages) <= MOST_STAGES and (shown_stages[0], shown_stages[-1]) == (
        many[0],
        many[-1],
    )
    assert [stage.shaft_angle_rad for stage in shown_stages] == [
        many[n % 3].shaft_angle_rad for n in range(len(shown_stages))
    ]
    assert select_static_stages(many[:9]) == list(many[:9])


@pytest.mark.parametrize(("ppm", "jitter_s"), [(50.0, 0.002), (-200.0, 0.01), (0.0, 0.002)])
def test_clocks_are_told_within_what_they_are_told_to(ppm, jitter_s):
    (drift,) = clock_drifts(runs.clocked(ppm, jitter_s))
    assert abs(drift.ppm - ppm) < drift.half_ppm < 400.0 * jitter_s / 0.01
    assert drift.span_s == pytest.approx(60.0, abs=0.5)


def test_a_device_that_was_started_anew_counts_since_then():
    (drift,) = clock_drifts(runs.clocked(50.0, 0.001, restarts=True))
    assert abs(drift.ppm - 50.0) < drift.half_ppm and drift.span_s == pytest.approx(30.0, abs=0.5)


def test_a_moment_is_too_short_to_tell_a_clock():
    assert clock_drifts(runs.clocked(50.0, 0.001, seconds=0.5)) == []


def test_the_same_run_gives_the_same_page():
    assert shown(runs.tripped())[0] == shown(runs.tripped())[0]


def test_a_run_that_went_on_with_other_limits_is_held_against_those_in_force():
    cut = runs.tripped()
    label = runs.FLAPS[1].label
    resumed = {
        "event": "run resumed",
        "t_s": 0.0,
        "utc": "2000",
        "stopped": runs.TRIP,
        "rig_changes": {"limits.force_N": "150.0"},
    }
    events = "\n".join(
        [
            cut.provenance["events"],
            json.dumps(resumed),
            json.dumps({"event": "stage begins", "t_s": 0.7, "stage": label}),
        ]
    )
    provenance = {
        **cut.provenance,
        "events": events,
        "resumed": json.dumps([resumed]),
        "ended": "done",
        "reason": "done",
    }
    _, text, story = shown(replace(cut, strokes=strokes()[:2], provenance=provenance))
    shares = [
        float(row["peak_force_N"]) / float(row["force_of_limit_pct"])
        for row in rows(tables_of(story)[0])
    ]
    assert shares == pytest.approx([3.0, 3.0, 1.5])
    assert [(part.begun.t_s, bool(part.ended)) for part in story.parts] == [
        (1.0, False),
        (4.0, True),
        (0.7, False),
    ]
    assert "300 N, later 150 N" in text and "at 2000 with limits.force_N 150.0, had stopped" in text


def test_events_that_are_none_are_passed_over():
    odd = runs.done()
    events = "not json\n[1, 2]\n{}\n" + odd.provenance["events"]
    assert (
        story_of(replace(odd, provenance={**odd.provenance, "events": events})).events
        == story_of(odd).events
    )
