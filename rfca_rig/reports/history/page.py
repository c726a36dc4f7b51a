"""Writes the history of a rig: history.html, a page as a list of its sections, history.csv and
history.json.
"""

import json
from datetime import datetime
from pathlib import Path

from markupsafe import Markup

from rfca_rig.diagnosis.reference.history import FALSE_TRENDS, INTERVAL
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.reports.elements import (
    aside,
    bullets,
    figure,
    folded,
    html,
    join,
    legend,
    legend_dot,
    legend_line,
    paragraph,
)
from rfca_rig.reports.history.pictures import TrackedValue, draw_value
from rfca_rig.reports.history.result import INTERVAL_STDS, RigHistory, words_of
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.provenance import Origin, version_text
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.table import Table, TableColumn, TableRow, as_csv
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import count_noun

HTML = "history.html"
CSV = "history.csv"
JSON = "history.json"
FILES = (CSV, JSON)


def write_history(history: RigHistory, out: Path, command: str) -> None:
    """Write the page and its files into `out`. Raises RigError where the disk refuses."""
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / CSV, as_csv(_make_run_table(history)).encode("utf-8"))
    text = json.dumps(history.plain(), indent=1)
    write_atomically(out / JSON, text.encode("utf-8"))
    write_atomically(out / HTML, make_page(history, command).encode("utf-8"))


def make_page(history: RigHistory, command: str) -> str:
    """The page as HTML; `command` makes it again."""
    count = count_noun(len(history.runs), "run")
    opening = [
        paragraph("History of a rig", "of"),
        html("<h1>{}</h1>", history.sentence()),
        paragraph(
            f"{history.rig}: {count}, each compared with the reference "
            f"{', '.join(history.reference)}.",
            "standfirst",
        ),
    ]
    sections = [
        PageSection("Trends", [as_html(_make_trend_table(history)), _explain_trends()]),
        _draw_values(history),
        PageSection("Runs", [folded(f"The numbers of {count}", as_html(_make_run_table(history)))]),
        _list_left_out(history),
    ]
    origin = Origin(command, (), version_text())
    return render_page("History of a rig", join("\n", opening), sections, origin, FILES)


def _make_trend_table(history: RigHistory) -> Table:
    rows = []
    for name, trend in history.trends.items():
        last = history.runs[-1].changes[name]
        values: dict[str, float | str] = {
            "value": words_of(name),
            "unit": history.units[name],
            "last": last.value,
            "last_half": INTERVAL_STDS * last.std,
        }
        if trend is not None:
            values |= {
                "rise": trend.change,
                "rise_half": trend.half_width,
                "trend": f"over {trend.over}" if trend.is_clear else "no",
            }
        rows.append(TableRow(values, marked=name in history.clear_trends))
    columns = (
        TableColumn("value", "value"),
        TableColumn("unit", "unit"),
        TableColumn("last", "last run", half="last_half", over="change since the reference"),
        TableColumn("last_half", role="kept"),
        TableColumn("rise", "first to last run", half="rise_half", over="trend"),
        TableColumn("rise_half", role="kept"),
        TableColumn("trend", "clear", over="trend"),
    )
    caption = f"Changes since the reference and their trends; \u00b1 is {100 * INTERVAL:g} %."
    return Table("trends", caption, columns, tuple(rows))


def _explain_trends() -> Markup:
    return aside(
        "The trend is a straight line through all runs, over time or from run to run, whichever "
        "describes them better. It is clear where chance would make one as clear in fewer than "
        f"{100 * FALSE_TRENDS:g} % of all histories."
    )


def _draw_values(history: RigHistory) -> PageSection:
    key = legend(
        legend_dot("var(--measured)", "var(--measured)", 3.0, f"a run, {100 * INTERVAL:g} %"),
        legend_line("var(--simulated)", 2.2, "clear trend"),
    )
    figures = [
        figure(words_of(name).capitalize(), draw_value(TrackedValue(history, name)))
        for name in history.units
    ]
    return PageSection("Run by run", [key, *figures])


def _make_run_table(history: RigHistory) -> Table:
    columns = [TableColumn("run", "run"), TableColumn("began", "begun")]
    for name, unit in history.units.items():
        head = ", ".join(filter(None, (words_of(name), unit)))
        columns.append(TableColumn(name, head, half=f"{name}_half"))
        columns.append(TableColumn(f"{name}_half", role="kept"))
    rows = []
    for run in history.runs:
        values: dict[str, float | str] = {
            "run": run.folder,
            "began": f"{datetime.fromtimestamp(run.began_s):%Y-%m-%d %H:%M}",
        }
        for name, change in run.changes.items():
            values[name] = change.value
            values[f"{name}_half"] = INTERVAL_STDS * change.std
        rows.append(TableRow(values))
    caption = f"Change of each value since the reference; \u00b1 is {100 * INTERVAL:g} %."
    return Table("history", caption, tuple(columns), tuple(rows))


def _list_left_out(history: RigHistory) -> PageSection | None:
    if not history.left_out:
        return None
    return PageSection("Left out", [bullets(f"{run}: {why}" for run, why in history.left_out)])
