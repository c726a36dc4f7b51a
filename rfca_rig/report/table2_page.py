"""report.html: one self-contained page with Table II, the forces at the peak, and every stroke over the model."""

from collections.abc import Sequence
from typing import Any

from rfca_rig.analysis.compare import PAPER_AVERAGE_ERROR_PCT, Table2
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.model.parameters import RigModel
from rfca_rig.report import overlay
from rfca_rig.report.provenance import PageContext
from rfca_rig.report.quantities import parameter_lines
from rfca_rig.report.sources import ComparedSource
from rfca_rig.report.stage_table import stage_tables
from rfca_rig.report.table import Table, TableColumn, TableRow
from rfca_rig.report.table2_files import as_table
from rfca_rig.report.templates import template
from rfca_rig.report.text import (
    DEFINITION,
    REGIONS_DEFINITION,
    SHAFT_WORDS,
    count_noun,
    keep_units_together,
    number,
    regions_sentence,
    repeats_sentence,
    rms_sentence,
    scales_sentence,
    shaft_sentence,
)

COLUMNS = (
    TableColumn("part", role="group"),
    TableColumn("parameter", "Parameter"),
    TableColumn("value", "Value"),
    TableColumn("unit", "Unit"),
)


def model_table(rig: RigModel) -> Table:
    """Parameters of a model by section, in the units of a lab."""
    rows = [{"part": q.section, "parameter": q.name, "value": q.value, "unit": q.unit} for q in parameter_lines(rig)]
    return Table("model", "", COLUMNS, tuple(TableRow(row) for row in rows))


def page(sources: Sequence[ComparedSource], table: Table2, peaks: Table, shaft: Shaft, told: PageContext) -> str:
    """The page as HTML.

    Parameters
    ----------
    sources
        Recordings compared with their models.
    table
        Table II of all of them.
    peaks
        Table of the forces at the peak.
    shaft
        How the simulated shaft turned.
    told
        Origin of the page, links to others, and the given model.
    """
    return template("table2.html").render(
        sheets=(),
        origin=told.origin,
        files=tuple(f"{stem}.{kind}" for stem in ("table2", peaks.name) for kind in ("csv", "tex", "json")),
        links=told.links,
        title=" · ".join(dict.fromkeys(source.recording.title for source in sources)) or "Nothing recorded",
        standfirst=_standfirst(table),
        sources=[_source(source) for source in sources],
        table=as_table(table, SHAFT_WORDS[shaft]),
        peaks=peaks,
        figures=_figures(sources, shaft),
        static_tables=[table for source in sources for table in stage_tables(source.name, source.recording.static)],
        models=_models(sources, told.model_file),
        definition=DEFINITION,
        regions_definition=REGIONS_DEFINITION,
    )


def _standfirst(table: Table2) -> str:
    time, force = table.average_time_error_pct, table.average_force_error_pct
    if time is None or force is None:
        return "No valley could be compared." if table.rows else "Static stages; no strokes were recorded."
    paper_time, paper_force = PAPER_AVERAGE_ERROR_PCT
    return (
        f"The model meets the valley of fz to {number(time, 2)} % in time and {number(force, 2)} % in force on average; "
        f"the model of the paper met its rig to {paper_time} % and {paper_force} %."
    )


def _source(source: ComparedSource) -> dict[str, Any]:
    recording = source.recording
    contents = []
    if recording.strokes:
        contents.append(f"{count_noun(len(recording.strokes), 'stroke')} at {count_noun(len(source.compared), 'condition')}")
    if recording.static:
        contents.append(count_noun(len(recording.static), "static stage"))
    return {"name": source.name, "mark": recording.source, "holds": " and ".join(contents) or "nothing recorded"}


def _figures(sources: Sequence[ComparedSource], shaft: Shaft) -> list[dict[str, Any]]:
    several = sum(bool(source.compared) for source in sources) > 1
    all_compared = [(source, compared) for source in sources for compared in source.compared]
    figures = []
    for place, (source, compared) in enumerate(all_compared, start=1):
        drawn = overlay.draw_overlay(compared, salt=f"figure {place}")
        figures.append(
            {
                "number": place,
                "label": compared.condition.label,
                "source": source.name if several else "",
                "svg": drawn.svg,
                "caption": keep_units_together(
                    f"{repeats_sentence(compared)} {shaft_sentence(compared, shaft)} {regions_sentence(compared, drawn)} "
                    f"{rms_sentence(compared)} {scales_sentence(drawn)}"
                ),
            }
        )
    return figures


def _models(sources: Sequence[ComparedSource], model_file: str | None) -> list[dict[str, Any]]:
    """One table for each distinct model, with the sources that share it."""
    distinct = list(dict.fromkeys(source.rig for source in sources if source.rig is not None))
    tables = []
    for rig in distinct:
        sharing = [source for source in sources if source.rig == rig]
        tables.append({"says": _model_says(sharing, model_file, len(distinct) > 1), "table": model_table(rig)})
    return tables


def _model_says(sharing: Sequence[ComparedSource], model_file: str | None, several: bool) -> str:
    what = f"The model in {model_file}, given for this report" if model_file else "The model as it was believed before the recordings"
    of_whom = f", of {', '.join(source.name for source in sharing)}" if several else ""
    known_to = sharing[0].recording.known_to
    if model_file or not known_to:
        return f"{what}{of_whom}."
    stated = ", ".join(f"{name} = {value:g}" for name, value in known_to.items() if isinstance(value, int | float))
    return f"{what}{of_whom}. One standard deviation of what was believed: {stated}; what is not listed counts as exact."
