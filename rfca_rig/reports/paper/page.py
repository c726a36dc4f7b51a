"""Writes the page on section IV of the paper: paper.html, its tables, paper.json, and the folder
figures.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

from rfca_rig.analysis.compare import PAPER_AVERAGE_ERROR_PCT, Table2
from rfca_rig.analysis.crosscheck import PAPER_PCT, average_pct
from rfca_rig.analysis.reproduction import Reproduction
from rfca_rig.reports.elements import (
    aside,
    code,
    division,
    figure,
    html,
    join,
    legend,
    legend_box,
    legend_diamond,
    legend_dot,
    legend_line,
    link,
    list_sources,
    paragraph,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.paper.pictures import (
    check_csv,
    make_check_figure,
    make_curve_figure,
    make_stroke_figure,
    stroke_csv,
)
from rfca_rig.reports.paper.tables import (
    describe_valley,
    make_material_table,
    make_table2,
    make_valley_table,
)
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.static.tables import full_curve_table, values_table
from rfca_rig.reports.strokes.tables import record
from rfca_rig.reports.style import drawing, inline_svg, save_picture
from rfca_rig.reports.table import as_csv, table_files, write_all
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import count_noun, format_significant, keep_units_together

FORMAT = "rfca-paper/1"
HTML = "paper.html"
JSON = "paper.json"
FIGURES = "figures"
PICTURE_FORMATS = ("svg", "pdf")
# Letters of Fig. 7 from the first condition on.
FIRST_CONDITION = ord("c")


@dataclass(frozen=True)
class PaperStep:
    """One step of the work: what it did, the command that does it alone, and its page, "" for
    none.
    """

    words: str
    command: str
    page: str = ""


@dataclass(frozen=True)
class PaperContext:
    """What the page states beside the numbers.

    Parameters
    ----------
    origin
        Command, recordings and version for the foot.
    sources
        Mark and title of each recording.
    steps
        In the order in which they were taken.
    following
        The command to go on with.
    """

    origin: Origin
    sources: tuple[tuple[str, str], ...]
    steps: tuple[PaperStep, ...]
    following: str


@dataclass(frozen=True)
class PaperFigure:
    """One part of Fig. 7: its letter, its heading and caption, how it is drawn, and its numbers."""

    letter: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    csv: str

    @property
    def is_of_strokes(self) -> bool:
        """Whether it is one of (c) and on."""
        return ord(self.letter) >= FIRST_CONDITION

    @property
    def name(self) -> str:
        """Name of its files without the ending."""
        return f"fig-7{self.letter}"


def write_paper(reproduction: Reproduction, out: Path, context: PaperContext) -> None:
    """Writes the page, its tables and figures into `out`. The same input gives the same bytes.

    Raises RigError where a file cannot be written.
    """
    figures = list_figures(reproduction)
    tables = (make_material_table(), make_table2(reproduction), make_valley_table(reproduction))
    files = {
        **table_files(tables),
        JSON: json.dumps(summarize(reproduction), indent=1, allow_nan=False) + "\n",
    }
    drawings = {shown.letter: draw_inline(shown) for shown in figures}
    page = make_page(reproduction, figures, drawings, context, tuple(files))
    write_all(out, {**files, HTML: page})
    write_all(out / FIGURES, {f"{shown.name}.csv": shown.csv for shown in figures})
    for shown in figures:
        for ending in PICTURE_FORMATS:
            save_figure(shown, out / FIGURES / f"{shown.name}.{ending}")


def list_figures(reproduction: Reproduction) -> list[PaperFigure]:
    """The parts of Fig. 7 that there are, in the order of their letters."""
    figures = []
    if reproduction.checked:
        first = reproduction.checked[0]
        figures.append(
            PaperFigure(
                "a",
                f"Contact force at {first.label}",
                f"This model and MuJoCo with the same springs and the same ground: "
                f"{format_significant(first.stroke_pct, 2)} % apart over the stroke, "
                f"{format_significant(average_pct(reproduction.checked), 2)} % on average over "
                f"{count_noun(len(reproduction.checked), 'condition')}. The paper\u2019s model and "
                f"RecurDyn: {PAPER_PCT:g} %.",
                partial(make_check_figure, first),
                check_csv(reproduction.checked),
            )
        )
    static = reproduction.static
    values = static.values
    figures.append(
        PaperFigure(
            "b",
            "Torque over rotation of a hinge",
            f"From {count_noun(len(static.data.stages), 'static stage')}: k0 "
            f"{values.k0_Nm_per_rad:.3f} ± {values.reach * values.k0_std:.3f} N m/rad, k2 "
            f"{values.k2_per_rad2:.3f} ± {values.reach * values.k2_std:.3f} 1/rad² (95 %).",
            partial(make_curve_figure, static),
            as_csv(full_curve_table(static.curve)),
        )
    )
    for place, shown in enumerate(reproduction.conditions):
        row = shown.average
        figures.append(
            PaperFigure(
                chr(FIRST_CONDITION + place),
                shown.condition.label,
                f"{count_noun(len(row.repeats), 'repeat')}. Average speed of the shaft: "
                f"{row.simulated[0].shaft_speed_rad_s:.3f} rad/s.",
                partial(make_stroke_figure, shown),
                stroke_csv(shown),
            )
        )
    return figures


def draw_inline(shown: PaperFigure) -> str:
    """The figure as an <svg> element."""
    with drawing():
        return inline_svg(shown.draw(), shown.name, f"figure 7 ({shown.letter}): {shown.title}")


def save_figure(shown: PaperFigure, path: Path) -> None:
    """Writes the figure in the format of the ending of `path`. Raises RigError."""
    with drawing():
        # Text stays text, and the ids in the file are the same each time.
        mpl.rcParams.update({"svg.hashsalt": shown.name, "svg.fonttype": "none"})
        save_picture(shown.draw(), path)


def summarize(reproduction: Reproduction) -> dict[str, Any]:
    """The document for programs."""
    values = reproduction.static.values
    inside, known = reproduction.inside
    document: dict[str, Any] = {
        "format": FORMAT,
        "k0_Nm_per_rad": round(values.k0_Nm_per_rad, 6),
        "k0_std_Nm_per_rad": round(values.k0_std, 6),
        "k2_per_rad2": round(values.k2_per_rad2, 6),
        "k2_std_per_rad2": round(values.k2_std, 6),
        "at_average_speed": _summarize_table(reproduction.table2),
        "along_recorded_shaft": _summarize_table(reproduction.table2_recorded),
        "predicted": [dict(describe_valley(shown)) for shown in reproduction.by_height],
        "measured_values_in_95_interval": inside,
        "measured_values": known,
        "against_mujoco_pct": None,
        "not_checked": reproduction.not_checked,
    }
    if reproduction.checked:
        document["against_mujoco_pct"] = round(average_pct(reproduction.checked), 5)
    return document


def _summarize_table(table: Table2) -> dict[str, Any]:
    return {
        "rows": [record(row) for row in table.rows],
        "average_time_error_pct": table.average_time_error_pct,
        "average_force_error_pct": table.average_force_error_pct,
    }


def describe_result(reproduction: Reproduction) -> list[str]:
    """The result in lines for a terminal, which the page states too."""
    paper_time, paper_force = PAPER_AVERAGE_ERROR_PCT
    inside, known = reproduction.inside
    if not known:
        return ["no stroke has a measured and a predicted valley"]
    lines = [
        f"nothing fitted to strokes, shaft at its average speed: {_errors(reproduction.table2)} "
        f"(the paper: {paper_time} and {paper_force} %)",
        f"along the recorded shaft: {_errors(reproduction.table2_recorded)}; {inside} of {known} "
        "measured values in their predicted 95 % interval",
    ]
    if reproduction.checked:
        apart = format_significant(average_pct(reproduction.checked), 2)
        lines.append(
            f"contact force against MuJoCo: {apart} % (the paper against RecurDyn: {PAPER_PCT:g} %)"
        )
    else:
        lines.append(f"no cross-check: {reproduction.not_checked}")
    return lines


def _errors(table: Table2) -> str:
    time_pct = table.average_time_error_pct
    force_pct = table.average_force_error_pct
    if time_pct is None or force_pct is None:
        return "no valley could be compared"
    return f"{time_pct:.1f} % in time, {force_pct:.1f} % in force"


def make_page(
    reproduction: Reproduction,
    figures: Sequence[PaperFigure],
    drawings: Mapping[str, str],
    context: PaperContext,
    files: Sequence[str],
) -> str:
    """The page as HTML.

    Parameters
    ----------
    reproduction
        What is shown.
    figures
        The parts of Fig. 7.
    drawings
        The <svg> element of each, by its letter.
    context
        Origin, recordings and steps.
    files
        Names of the tables beside the page.
    """
    opening = join(
        "\n",
        [
            paragraph("Section IV of the paper, reproduced", "of"),
            html("<h1>{}</h1>", _headline(reproduction)),
            list_sources(context.sources),
            paragraph(keep_units_together(_standfirst(reproduction)), "standfirst"),
            html("<p>Next: {}</p>", code(context.following)),
        ],
    )
    by_letter = {shown.letter: _show(shown, drawings[shown.letter]) for shown in figures}
    strokes = [by_letter[shown.letter] for shown in figures if shown.is_of_strokes]
    sections = [
        PageSection(
            "Table II: nothing fitted to strokes",
            [as_html(make_table2(reproduction)), as_html(make_valley_table(reproduction))],
        ),
        PageSection(
            "Fig. 7 (c) and on: strokes", [_stroke_legend(), division("figures", *strokes)]
        ),
        PageSection(
            "Fig. 7 (b): torque over rotation",
            [by_letter["b"], as_html(values_table(reproduction.static))],
        ),
        PageSection(
            "Fig. 7 (a): cross-check", [by_letter.get("a") or _say_not_checked(reproduction)]
        ),
        PageSection("Table I: materials", [as_html(make_material_table())]),
        PageSection("Steps", [_list_steps(context.steps)]),
    ]
    return render_page("Section IV of the paper", opening, sections, context.origin, files)


def _headline(reproduction: Reproduction) -> str:
    table = reproduction.table2_recorded
    if table.average_time_error_pct is None:
        return "From static stages to strokes"
    return f"From static stages to strokes: the valley is met to {_errors(table)}"


def _standfirst(reproduction: Reproduction) -> str:
    paper_time, paper_force = PAPER_AVERAGE_ERROR_PCT
    inside, known = reproduction.inside
    if not known:
        return "No stroke has a measured and a predicted valley."
    return (
        "The springs of the model come from static stages and its other values from the rig file. "
        "Nothing is fitted to strokes. The numbers above hold along the recorded shaft, where "
        f"{inside} of {known} measured values are in their predicted 95 % interval. With the shaft "
        f"at its average speed, as in the paper, it is {_errors(reproduction.table2)}; the "
        f"paper\u2019s own rig: {paper_time} and {paper_force} %."
    )


def _stroke_legend() -> Markup:
    return legend(
        legend_line("var(--measured)", 1, "measured, each repeat"),
        legend_line("var(--simulated)", 4, "model, shaft at its average speed"),
        legend_line("var(--other)", 1.4, "model along the recorded shaft", "4 2"),
        legend_dot("var(--measured)", "none", 4.6, "measured valley; below, their mean"),
        legend_diamond("var(--edge)", "var(--simulated)", "simulated valley"),
        legend_box("predicted 95 % interval", style="border-color: var(--other)"),
    )


def _show(shown: PaperFigure, svg: str) -> Markup:
    files = join(
        ", ",
        [
            link(f"{FIGURES}/{shown.name}.{ending}", ending.upper())
            for ending in (*PICTURE_FORMATS, "csv")
        ],
    )
    caption = html("{} {}.", shown.caption, files)
    css = "small"
    if shown.is_of_strokes:
        css = ""
    return figure(f"({shown.letter}) {shown.title}", svg, caption, css=css)


def _say_not_checked(reproduction: Reproduction) -> Markup:
    return paragraph(f"Left out: {reproduction.not_checked}")


def _list_steps(steps: Sequence[PaperStep]) -> Markup:
    items = []
    for step in steps:
        words: str | Markup = step.words
        if step.page:
            words = link(step.page, step.words)
        items.append(html("<li>{}<br>{}</li>", words, code(step.command)))
    return html(
        "<ol>\n{}\n</ol>\n{}", join("\n", items), aside("Each command does its step alone.")
    )
