"""Writes the summary of a sweep: sweep.html, one self-contained page as a list of its sections,
and sweep.json, beside sweep.h5 and sweep.csv.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rfca_rig import __version__
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.reports.elements import (
    aside,
    bullets,
    division,
    figure,
    html,
    join,
    paragraph,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.provenance import Origin, version_text
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.sweep.pictures import (
    MOST_GROUPS,
    OutputSensitivity,
    SampleGroup,
    View,
    compute_sensitivities,
    draw_points,
    draw_view,
    formula,
    name_and_unit,
    sample_groups,
    sensitivities_table,
    value_text,
    views,
    with_unit,
)
from rfca_rig.reports.table import Table, TableColumn, TableRow
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import count_noun, number
from rfca_rig.sweep.outputs import RequestedOutput
from rfca_rig.sweep.plan import Axis, Range, points
from rfca_rig.sweep.quantities import find_quantity
from rfca_rig.sweep.result import CSV, H5, SweepResult

FILES = [CSV, H5, "sweep.json"]
DEFINITIONS = (
    "Over a stroke, from the commanded start to the end of the shaft's turn; t* is the "
    "moment of the greatest load while the leg presses: "
    "it touches, and touchdown, the first 30 ms of contact, is over."
)

FORMAT = "rfca-sweep-summary/1"
HTML = "sweep.html"
JSON = "sweep.json"


def page(result: SweepResult, found: list[OutputSensitivity], command: str) -> str:
    """The page as HTML.

    Parameters
    ----------
    result
        The sweep.
    found
        Sensitivities of outputs to sampled quantities; empty for a grid.
    command
        The command line, for the foot of the page.
    """
    title = _page_title(result)
    opening = [
        paragraph("Sweep of the model", "of"),
        html("<h1>{}</h1>", title),
        paragraph(_standfirst(result), "standfirst"),
    ]
    sections = [
        _results(result, found),
        _dependences(found),
        _failures(result),
        PageSection("Inputs", [as_html(_quantities_table(result))]),
        PageSection("Outputs", [as_html(_outputs_table(result))]),
    ]
    return render_page(
        title,
        join("\n", opening),
        sections,
        Origin(command, (), version_text()),
        FILES,
        # The shades of its maps have one meaning only on light paper.
        is_always_light=True,
    )


def _results(result: SweepResult, found: list[OutputSensitivity]) -> PageSection:
    figures, left_out = _figures(result, found)
    samples = result.plan.samples
    if samples is not None and len(samples.ranges) > 2:
        # A figure of many panels takes the width of the page.
        contents = figures
    else:
        contents = [division("figures", *figures)]
    without = [_title(asked) for asked in result.plan.outputs if asked not in _with_values(result)]
    if without:
        contents.append(aside(f"Without any value: {', '.join(without)}."))
    if left_out:
        combinations = count_noun(left_out, "more combination")
        contents.append(
            aside(f"{combinations} of the other values are in sweep.csv, and not drawn.")
        )
    return PageSection("Results", contents)


def _dependences(found: list[OutputSensitivity]) -> PageSection | None:
    if not found:
        return None
    how_estimated = (
        "Estimated from these very cases: least squares of the output on a cubic spline of one "
        "quantity, adjusted for the number of coefficients; the standard error by a bootstrap of "
        "the cases, rather too large for points this even."
    )
    sensitivities = as_html(sensitivities_table(found))
    return PageSection("What it depends on", [sensitivities, aside(how_estimated)])


def _failures(result: SweepResult) -> PageSection | None:
    reasons = [f"{count_noun(count, 'time')}: {reason}" for reason, count in result.reasons()]
    if not reasons:
        return None
    text = "The column remark of sweep.csv says it for each case, with its numbers."
    return PageSection("What could not be computed", [bullets(reasons), aside(text)])


def _page_title(result: SweepResult) -> str:
    """The title, with names of columns in words."""
    title = result.plan.title
    for name in sorted(result.plan.varied, key=len, reverse=True):
        title = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", name_and_unit(name)[0], title)
    return title


def _standfirst(result: SweepResult) -> str:
    plan = result.plan
    sides = [
        f"{count_noun(len(axis.values), 'value')} of {name_and_unit(axis.name)[0]}"
        for axis in plan.axes
    ]
    if plan.samples:
        drawn = f"{plan.samples.n} points ({plan.samples.method}, seed {plan.samples.seed})"
        sides.append(f"{drawn} in {count_noun(len(plan.samples.names), 'range')}")
    text = f"{count_noun(plan.count, 'case')}: {' times '.join(sides)}."
    if result.failed:
        text += f" {count_noun(result.failed, 'case')} failed."
    if result.incomplete:
        text += f" {count_noun(result.incomplete, 'case')} without some output."
    return text


def _figures(
    result: SweepResult, sensitivities: list[OutputSensitivity]
) -> tuple[list[Markup], int]:
    """Figures of a grid or of samples, and the number of combinations that are not drawn."""
    figures: list[Markup] = []
    if result.plan.samples is not None:
        groups = list(sample_groups(result.plan))
        for group in groups[:MOST_GROUPS]:
            for asked in _with_values(result):
                number_of = len(figures) + 1
                figures.append(_points_figure(result, asked, group, sensitivities, number_of))
        return figures, max(len(groups) - MOST_GROUPS, 0)
    shown_views, there_are = views(result.plan)
    for view in shown_views:
        for asked in _with_values(result):
            figures.append(_grid_figure(result, asked, view, len(figures) + 1))
    return figures, there_are - len(shown_views)


def _with_values(result: SweepResult) -> list[RequestedOutput]:
    """Outputs with a value for at least one case."""
    return [
        asked for asked in result.plan.outputs if not np.isnan(result.output(asked.header)).all()
    ]


def _grid_figure(result: SweepResult, asked: RequestedOutput, view: View, number_of: int) -> Markup:
    values = view.values(result, asked.header)
    if view.is_map and np.isnan(values).any():
        crosses = " Crosses: no value."
    else:
        crosses = ""
    return figure(
        _title(asked),
        draw_view(view, values, asked.header),
        f"{formula(asked.output.equation)}. Column {asked.header} of {CSV}.{crosses}",
        number_of,
        ", ".join(with_unit(*fixed_value) for fixed_value in view.facet),
    )


def _points_figure(
    result: SweepResult,
    asked: RequestedOutput,
    group: SampleGroup,
    sensitivities: list[OutputSensitivity],
    number_of: int,
) -> Markup:
    samples = result.plan.samples
    assert samples is not None
    indices = [
        sensitivity.found
        for sensitivity in sensitivities
        if sensitivity.output == asked.header and sensitivity.at == group.at
    ]
    titles = [
        "" if index is None else f"explains {number(index.index, 2)} ± {index.std:.2f}"
        for index in indices
    ]
    drawn = draw_points(
        samples.ranges,
        points(samples),
        result.output(asked.header)[group.cases],
        titles,
        asked.header,
    )
    return figure(
        _title(asked),
        drawn,
        f"{formula(asked.output.equation)}. Column {asked.header} of {CSV}; above each panel the "
        "first-order share of variance.",
        number_of,
        ", ".join(with_unit(*fixed_value) for fixed_value in group.at),
    )


def _title(asked: RequestedOutput) -> str:
    return asked.words[:1].upper() + asked.words[1:]


def _quantities_table(result: SweepResult) -> Table:
    plan = result.plan
    rows = [_axis_row(axis) for axis in plan.axes]
    if plan.samples:
        rows += [_range_row(sampled) for sampled in plan.samples.ranges]
    rows += [_row(name, value_text(value), "", "fixed") for name, value in plan.fixed]
    columns = (
        TableColumn("what"),
        TableColumn("values"),
        TableColumn("how_many", "number"),
        TableColumn("column", "column"),
    )
    return Table("varied", "All other values are nominal.", columns, tuple(rows))


def _axis_row(axis: Axis) -> TableRow:
    # Up to eight values are listed, of more only the ends.
    if len(axis.values) <= 8:
        values = ", ".join(map(value_text, axis.values))
    else:
        values = f"{value_text(axis.values[0])} to {value_text(axis.values[-1])}"
    spacing = ""
    if axis.log:
        spacing = "equal ratios"
    return _row(axis.name, values, spacing, f"{len(axis.values)}")


def _range_row(sampled: Range) -> TableRow:
    values = f"{value_text(sampled.low)} to {value_text(sampled.high)}"
    spacing = ""
    if sampled.log:
        spacing = "evenly in the logarithm"
    return _row(sampled.name, values, spacing, "drawn")


def _row(name: str, values: str, spacing: str, number: str) -> TableRow:
    words = find_quantity(name).words
    unit = name_and_unit(name)[1]
    if unit:
        values = f"{values} {unit}"
    text = ", ".join(filter(None, (values, spacing)))
    return TableRow(
        {
            "what": f"{words[:1].upper()}{words[1:]}",
            "values": text,
            "how_many": number,
            "column": name,
        }
    )


def _outputs_table(result: SweepResult) -> Table:
    rows = tuple(
        TableRow(
            {
                "what": _title(asked),
                "equation": formula(asked.output.equation),
                "source": asked.output.source,
                "column": asked.header,
            }
        )
        for asked in result.plan.outputs
    )
    columns = (
        TableColumn("what"),
        TableColumn("equation", "definition"),
        TableColumn("source"),
        TableColumn("column"),
    )
    return Table("outputs", DEFINITIONS, columns, rows)


def write_summary(result: SweepResult, folder: Path, command: str) -> None:
    """Writes sweep.html and sweep.json into `folder`.

    The same result and command give the same bytes. Raises RigError where a file cannot be written.
    """
    sensitivities = compute_sensitivities(result)
    write_atomically(
        folder / JSON,
        (
            json.dumps(
                summary(result, sensitivities), indent=1, ensure_ascii=False, allow_nan=False
            )
            + "\n"
        ).encode(),
    )
    write_atomically(folder / HTML, page(result, sensitivities, command).encode())


def summary(result: SweepResult, found: list[OutputSensitivity]) -> dict[str, Any]:
    """Content of sweep.json: varied and fixed quantities, outputs with their extremes and where
    those are, failures, sensitivities.
    """
    plan = result.plan
    return {
        "format": FORMAT,
        "version": __version__,
        "title": plan.title,
        "cases": plan.count,
        "failed": result.failed,
        "incomplete": result.incomplete,
        "reasons": [{"reason": reason, "cases": count} for reason, count in result.reasons()],
        "varied": list(plan.varied),
        "fixed": dict(plan.fixed),
        "outputs": [_output(result, index) for index in range(len(plan.outputs))],
        "sensitivities": [_sensitivity(sensitivity) for sensitivity in found],
    }


def _sensitivity(sensitivity: OutputSensitivity) -> dict[str, Any]:
    index = None
    std = None
    if sensitivity.found:
        index = sensitivity.found.index
        std = sensitivity.found.std
    return {
        "at": dict(sensitivity.at),
        "output": sensitivity.output,
        "of": sensitivity.name,
        "index": index,
        "std": std,
    }


def _output(result: SweepResult, index: int) -> dict[str, Any]:
    asked = result.plan.outputs[index]
    values = result.values[:, index]
    description = {
        "name": asked.header,
        "words": asked.words,
        "equation": asked.output.equation,
        "source": asked.output.source,
    }
    # nanargmin raises an error where all values are NaN.
    if np.isnan(values).all():
        return {**description, "lowest": None, "highest": None}
    return {
        **description,
        "lowest": _end(result, values, int(np.nanargmin(values))),
        "highest": _end(result, values, int(np.nanargmax(values))),
    }


def _end(result: SweepResult, values: np.ndarray[Any, Any], case: int) -> dict[str, Any]:
    plan = result.plan
    return {
        "value": float(values[case]),
        "case": case,
        "at": dict(zip(plan.varied, plan.point(case), strict=True)),
    }


def lines(result: SweepResult) -> list[str]:
    """Summary for a terminal: the extremes of each output, and where they are."""
    content = summary(result, [])
    parts = [
        (result.failed, "failed"),
        (result.incomplete, "without some output"),
        (result.mistakes, "met a mistake of rfca-rig"),
    ]
    failures = "".join(f", {count} {words}" for count, words in parts if count)
    text = [f"{result.plan.title}: {count_noun(result.plan.count, 'case')}{failures}"]
    for output in content["outputs"]:
        low = output["lowest"]
        high = output["highest"]
        extremes = "none"
        if low is not None:
            extremes = f"{_end_line(result, low)} to {_end_line(result, high)}"
        text.append(f"{output['name']}: {extremes}")
    return text + [
        f"  {reason['cases']} times: {reason['reason']}" for reason in content["reasons"]
    ]


def _end_line(result: SweepResult, end: dict[str, Any]) -> str:
    """An extreme with its point on the grid. Sampled values are left out: they are in sweep.csv."""
    settings = [
        with_unit(name, value)
        for name, value in end["at"].items()
        if result.plan.samples is None or name not in result.plan.samples.names
    ]
    if settings:
        return f"{value_text(end['value'])} ({', '.join(settings)})"
    return value_text(end["value"])
