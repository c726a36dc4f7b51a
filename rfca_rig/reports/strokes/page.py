"""report.html: one self-contained page with Table II, the forces at the peak, and every stroke
over the model, as a list of its sections.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rfca_rig.analysis.acceptance import AcceptanceTests, run_acceptance_tests
from rfca_rig.analysis.compare import (
    PAPER_AVERAGE_ERROR_PCT,
    ComparedCondition,
    Table2,
    Table2Row,
    compare_condition,
    make_table2_row,
)
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.analysis.peak_force import PeakForceRow, make_peak_row
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.model_file import nominal_model
from rfca_rig.description.tolerances_file import TolerancesFile
from rfca_rig.model.parameters import LawTable, RigModel, TorqueSpline
from rfca_rig.model.tabulated_law import kind_of
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.model import Recording
from rfca_rig.reports.elements import (
    csv_links,
    division,
    figure,
    html,
    join,
    legend,
    legend_diamond,
    legend_dot,
    legend_line,
    list_sources,
    page_links,
    paragraph,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.provenance import Origin, PageContext, PageLink, find_pages, origin_in_memory
from rfca_rig.reports.run.page import page as run_page
from rfca_rig.reports.run.page import tables_of
from rfca_rig.reports.run.parts import story_of
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.strokes import overlay
from rfca_rig.reports.strokes.acceptance import (
    acceptance_json,
    make_acceptance_section,
    make_acceptance_table,
)
from rfca_rig.reports.strokes.tables import (
    as_json,
    as_table,
    peaks_as_json,
    peaks_as_table,
    stage_tables,
)
from rfca_rig.reports.strokes.traces import trace_csv
from rfca_rig.reports.table import Table, TableColumn, TableRow, table_files, write_all
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import (
    DEFINITION,
    REGIONS_DEFINITION,
    SHAFT_WORDS,
    count_noun,
    keep_units_together,
    number,
    number_equal_names,
    regions_sentence,
    repeats_sentence,
    rms_sentence,
    scales_sentence,
    shaft_sentence,
)

# Ending of the name: unit shown, factor. The first match counts, so longer endings come before
# their parts ("_Nm_per_rad", "_rad").
UNITS = {
    "_Nm_s_per_rad": ("N m s/rad", 1.0),
    "_Nm_per_rad": ("N m/rad", 1.0),
    "_N_per_m1p5": ("N/m^1.5", 1.0),
    "_N_s_per_m": ("N s/m", 1.0),
    "_N_per_m": ("N/m", 1.0),
    "_s_per_m": ("s/m", 1.0),
    "_per_rad2": ("1/rad²", 1.0),
    "_rad": ("deg", degrees(1.0)),
    "_kg": ("g", 1e3),
    "_m": ("mm", 1e3),
    "_s": ("s", 1.0),
}

SECTIONS = ("leg", "ground", "sensor", "drive")
UNLISTED = (
    "what is not listed counts as exact. A diagnosis also varies what is rarely measured "
    "of the floor, the swing of the leg at the start "
    "and the delay of the drive: the nuisance parameters of its page."
)
# Where a rig file says it in other words than the model does.
FILE_NAMES = {("ground", "drag_N_s_per_m"): "tangential_damping_N_s_per_m"}

COLUMNS = (
    TableColumn("part", role="group"),
    TableColumn("parameter", "Parameter"),
    TableColumn("value", "Value"),
    TableColumn("unit", "Unit"),
)


@dataclass(frozen=True)
class GivenModel:
    """A model that all recordings of a report are compared with, and the name of its file."""

    file: str
    rig: RigModel


@dataclass(frozen=True)
class ComparedSource:
    """One recording compared with a model condition by condition; `rows` and `peaks` correspond to
    `compared` one to one.

    `rig` is None where the recording has no nominal model and no stroke to compare.
    """

    name: str
    recording: Recording
    rig: RigModel | None
    compared: tuple[ComparedCondition, ...]

    @property
    def rows(self) -> tuple[Table2Row, ...]:
        return tuple(make_table2_row(compared, self.name) for compared in self.compared)

    @property
    def peaks(self) -> tuple[PeakForceRow, ...]:
        return tuple(make_peak_row(compared, self.name) for compared in self.compared)


def compare_sources(
    recordings: Sequence[Recording],
    shaft: Shaft,
    given: GivenModel | None = None,
    watcher: ProgressCount = ignore_progress,
) -> tuple[ComparedSource, ...]:
    """Compares each recording with the `given` model, or with its own nominal model where none is
    given.

    Parameters
    ----------
    recordings
        Recordings to compare.
    shaft
        How the simulated shaft turns, see `analysis.matched_simulation`.
    given
        A model for all recordings; None for each recording's own.
    watcher
        Progress callback: number of conditions done, number of conditions.

    Raises
    ------
    BadInput
        Where nominal values do not make a model.
    SimulationFailed
        Where a stroke cannot be simulated.
    """
    names = number_equal_names([recording.title for recording in recordings])
    conditions = [len(group_by_condition(recording.strokes)) for recording in recordings]
    return tuple(
        _compare(
            name,
            recording,
            shaft,
            given,
            _offset_watcher(watcher, sum(conditions[:number]), sum(conditions)),
        )
        for number, (name, recording) in enumerate(zip(names, recordings, strict=True))
    )


def _offset_watcher(watcher: ProgressCount, before: int, of: int) -> ProgressCount:
    """A watcher for one recording that reports to the one for all conditions; `before` is the
    number done before.
    """
    return lambda done, _: watcher(before + done, of)


def _compare(
    name: str, recording: Recording, shaft: Shaft, given: GivenModel | None, watcher: ProgressCount
) -> ComparedSource:
    if given is None and not recording.strokes and not recording.nominal:
        return ComparedSource(name, recording, None, ())
    if given is None:
        rig = nominal_model(recording.nominal)
    else:
        rig = given.rig
    conditions = iterate_with_progress(group_by_condition(recording.strokes), watcher)
    return ComparedSource(
        name,
        recording,
        rig,
        tuple(compare_condition(rig, condition, shaft) for condition in conditions),
    )


@dataclass(frozen=True)
class ParameterLine:
    """One line of a table of parameters."""

    section: str
    name: str
    value: str
    unit: str


def parameter_lines(rig: RigModel) -> list[ParameterLine]:
    """Every parameter of the model that has a value and is not switched off, section by section.

    It goes through the fields of the dataclasses, so that new parameters appear without a change
    here.
    """
    sections = [line for section in SECTIONS for line in _lines_of(section, getattr(rig, section))]
    effects = [
        _quantity("effect", f"{present.id} {name}", value)
        for present in rig.effects
        for name, value in present.values
    ]
    tables = [_of_table(present.table) for present in rig.effects if present.table is not None]
    return sections + effects + tables


def _lines_of(section: str, part: Any) -> list[ParameterLine]:
    values = {parameter.name: getattr(part, parameter.name) for parameter in fields(part)}
    curves = values.pop("torque_splines", ())
    if curves:
        # Unused beside measured curves.
        del values["k2_per_rad2"]
    lines = [
        _quantity(section, FILE_NAMES.get((section, name), name), value)
        for name, value in values.items()
        if value is not None and value is not False and value != ()
    ]
    for hinge, curve in enumerate(curves, start=2):
        whose = ""
        if len(curves) > 1:
            whose = f" of hinge {hinge}"
        lines.append(_of_curve(whose, part.k0_Nm_per_rad, curve))
    return lines


def _of_curve(whose: str, k0_Nm_per_rad: float, curve: TorqueSpline) -> ParameterLine:
    """The points of a measured curve, without (0, 0), which belongs to all."""
    points = zip(curve.angles_rad, curve.torques_rad, strict=True)
    text = ", ".join(
        f"{k0_Nm_per_rad * torque:.4g} at {degrees(angle):.3g}"
        for angle, torque in points
        if angle != 0.0
    )
    return ParameterLine("leg", f"torque{whose}", text, "N m at deg")


def _of_table(table: LawTable) -> ParameterLine:
    values = f"{len(table.values)} values, {min(table.values):.4g} to {max(table.values):.4g}"
    return ParameterLine(
        "effect",
        f"tabulated_law of {table.argument} at {table.place}",
        values,
        kind_of(table.place, table.argument).unit,
    )


def _quantity(section: str, name: str, value: Any) -> ParameterLine:
    ending = next((ending for ending in UNITS if name.endswith(ending)), "")
    unit, factor = UNITS.get(ending, ("", 1.0))
    return ParameterLine(
        section, name.removesuffix(ending).replace("_", " "), _number(value, factor), unit
    )


def _number(value: Any, factor: float) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_number(item, factor) for item in value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{factor * value:.6g}"
    return str(value)


def model_table(rig: RigModel) -> Table:
    """Parameters of a model by section, in the units of a lab."""
    rows = [
        {"part": q.section, "parameter": q.name, "value": q.value, "unit": q.unit}
        for q in parameter_lines(rig)
    ]
    return Table("model", "", COLUMNS, tuple(TableRow(row) for row in rows))


def page(
    sources: Sequence[ComparedSource],
    table: Table2,
    peaks: Table,
    shaft: Shaft,
    context: PageContext,
    tests: AcceptanceTests | None = None,
) -> str:
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
    context
        Origin of the page, links to others, and the given model.
    tests
        Acceptance tests, where they were asked for.
    """
    has_strokes = any(source.compared for source in sources)
    sections: list[PageSection | None] = []
    if has_strokes:
        kind = "measured and simulated strokes"
        sections = [
            _valley(sources, table, shaft),
            PageSection("Forces at the peak", [as_html(peaks)]),
            _strokes(sources, shaft),
        ]
    elif all(source.recording.is_listening for source in sources):
        kind = "recorded without motion"
    else:
        kind = "static stages"
    sections += [_static_stages(sources), _models(sources, context.model_file)]
    tables = ["table2", peaks.name]
    if tests is not None:
        # First: whoever asks for them reads the page for their outcome.
        sections.insert(0, make_acceptance_section(tests))
        tables.append(make_acceptance_table(tests).name)
    return render_page(
        f"{_join_titles(sources)}: {kind}",
        _opening(sources, table, context, has_strokes),
        sections,
        context.origin,
        files=tuple(f"{stem}.{kind}" for stem in tables for kind in ("csv", "tex", "json")),
    )


def _join_titles(sources: Sequence[ComparedSource]) -> str:
    titles = dict.fromkeys(source.recording.title for source in sources)
    return " · ".join(titles) or "Nothing recorded"


def _opening(
    sources: Sequence[ComparedSource], table: Table2, context: PageContext, has_strokes: bool
) -> Markup:
    if has_strokes:
        of = "Measured and simulated strokes"
    else:
        of = "What was recorded"
    is_alone = len(sources) == 1
    described = [(s.recording.source, _describe_source(s, is_alone)) for s in sources]
    return join(
        "\n",
        [
            paragraph(of, "of"),
            html("<h1>{}</h1>", _join_titles(sources)),
            list_sources(described),
            paragraph(_standfirst(sources, table), "standfirst"),
            page_links(context.links),
        ],
    )


def _standfirst(sources: Sequence[ComparedSource], table: Table2) -> str:
    time = table.average_time_error_pct
    force = table.average_force_error_pct
    if time is None or force is None:
        if table.rows:
            return "No valley could be compared."
        if any(source.recording.is_listening for source in sources) and not _has_static(sources):
            return "Recorded without motion: there is nothing to compare with a model."
        return "Static stages; no strokes were recorded."
    paper_time, paper_force = PAPER_AVERAGE_ERROR_PCT
    return (
        f"The model meets the valley of fz to {number(time, 2)} % in time and "
        f"{number(force, 2)} % in force on average; "
        f"the model of the paper met its rig to {paper_time} % and {paper_force} %."
    )


def _has_static(sources: Sequence[ComparedSource]) -> bool:
    return any(source.recording.static for source in sources)


def _describe_source(source: ComparedSource, is_alone: bool) -> str:
    """Name and content of a source. The name of a single one is the title of the page."""
    recording = source.recording
    contents = []
    if recording.strokes:
        contents.append(
            f"{count_noun(len(recording.strokes), 'stroke')} at "
            f"{count_noun(len(source.compared), 'condition')}"
        )
    if recording.static:
        contents.append(count_noun(len(recording.static), "static stage"))
    holds = " and ".join(contents) or "nothing recorded"
    if recording.is_listening:
        holds = "reports of the devices, without motion"
    if is_alone:
        return holds
    return f"{source.name}: {holds}"


def _valley(sources: Sequence[ComparedSource], table: Table2, shaft: Shaft) -> PageSection:
    # A campaign of that name says so in its title already.
    if any("Table II" in source.name for source in sources):
        title = "The valley of fz"
    else:
        title = "The valley of fz, as in Table II"
    shown = as_html(as_table(table, SHAFT_WORDS[shaft]))
    return PageSection(title, [shown, paragraph(DEFINITION)])


def _strokes(sources: Sequence[ComparedSource], shaft: Shaft) -> PageSection:
    """Every stroke over the model, a figure for each condition."""
    colours = legend(
        legend_line("var(--measured)", 1, "measured, each repeat"),
        legend_line("var(--simulated)", 4, "simulated"),
        legend_dot("var(--measured)", "none", 4.6, "measured valley"),
        legend_diamond("var(--edge)", "var(--simulated)", "simulated valley"),
    )
    several = sum(bool(source.compared) for source in sources) > 1
    figures = []
    for number_of, (source, compared) in enumerate(_list_compared(sources), start=1):
        title_of_source = ""
        if several:
            title_of_source = source.name
        drawn = overlay.draw_overlay(compared, salt=f"figure {number_of}")
        caption = (
            f"{repeats_sentence(compared)} {shaft_sentence(compared, shaft)} "
            f"{regions_sentence(compared, drawn)} "
            f"{rms_sentence(compared)} {scales_sentence(drawn)}"
        )
        shown_caption = html(
            "{} {}", keep_units_together(caption), csv_links(_name_traces(number_of))
        )
        figures.append(
            figure(
                compared.condition.label,
                drawn.svg,
                shown_caption,
                number_of,
                title_of_source,
            )
        )
    return PageSection(
        "Strokes", [colours, paragraph(REGIONS_DEFINITION), division("figures", *figures)]
    )


def _list_compared(
    sources: Sequence[ComparedSource],
) -> list[tuple[ComparedSource, ComparedCondition]]:
    """All conditions with their sources, in the order of their figures."""
    return [(source, compared) for source in sources for compared in source.compared]


def _name_traces(number_of: int) -> str:
    """File with the curves of a figure."""
    return f"strokes-{number_of}.csv"


def _static_stages(sources: Sequence[ComparedSource]) -> PageSection | None:
    tables = []
    for source in sources:
        for table in stage_tables(source.name, source.recording.static):
            tables.append(as_html(table, "dense"))
    if tables:
        return PageSection("Static stages", tables)
    return None


def _models(sources: Sequence[ComparedSource], model_file: str | None) -> PageSection | None:
    """One table for each distinct model, with the sources that share it."""
    distinct = list(dict.fromkeys(source.rig for source in sources if source.rig is not None))
    contents = []
    for number_of, rig in enumerate(distinct, start=1):
        sharing = [source for source in sources if source.rig == rig]
        contents.append(paragraph(_describe_model(sharing, model_file, len(distinct) > 1)))
        contents.append(as_html(model_table(rig), "dense", f"of model {number_of}"))
    if contents:
        return PageSection("The model", contents)
    return None


def _describe_model(
    sharing: Sequence[ComparedSource], model_file: str | None, several: bool
) -> str:
    if model_file:
        what = f"The model in {model_file}, given for this report"
    else:
        what = "The nominal model"
    if several:
        of_whom = f", of {', '.join(source.name for source in sharing)}"
    else:
        of_whom = ""
    known_to = sharing[0].recording.known_to
    beyond = _beyond_curves(sharing)
    if model_file or not known_to:
        return f"{what}{of_whom}.{beyond}"
    stated = ", ".join(
        f"{name} = {value:g}" for name, value in known_to.items() if isinstance(value, int | float)
    )
    return (
        f"{what}{of_whom}. One standard deviation of each nominal value: {stated}; "
        f"{UNLISTED}{beyond}"
    )


def _beyond_curves(sharing: Sequence[ComparedSource]) -> str:
    """Says where hinges bend farther than their torque was measured; beyond its last angle a
    curve is straight.
    """
    rig = sharing[0].rig
    if rig is None:
        return ""
    leg = rig.leg
    poses = [
        simulation.stroke.q_rad
        for source in sharing
        for compared in source.compared
        for simulation in compared.simulated
    ]
    if not leg.torque_splines or not poses:
        return ""
    bent = np.abs(
        np.diff(np.concatenate(poses), axis=1) - np.array(leg.rest_angles_rad or 0.0)
    ).max(axis=0)
    measured = np.broadcast_to(
        [np.abs(curve.angles_rad).max() for curve in leg.torque_splines], bent.shape
    )
    worst = int(np.argmax(bent - measured))
    if bent[worst] <= measured[worst]:
        return ""
    return (
        f" Hinge {worst + 2} bends to {degrees(bent[worst]):.1f} degrees in these "
        "strokes, and its torque was measured to "
        f"{degrees(measured[worst]):.1f}; beyond that the curve is straight."
    )


@dataclass(frozen=True)
class WrittenReport:
    """Table II, the paths of the pages, and the acceptance tests where they were asked for."""

    table: Table2
    pages: tuple[Path, ...]
    tests: AcceptanceTests | None = None


def _name_run_pages(sources: Sequence[ComparedSource]) -> dict[str, ComparedSource]:
    """One run has run.html, several have run-1.html, run-2.html."""
    if len(sources) == 1:
        return {"run.html": sources[0]}
    return {f"run-{number}.html": source for number, source in enumerate(sources, start=1)}


def write_report(
    recordings: Sequence[Recording],
    out_dir: Path,
    shaft: Shaft = "average",
    given: GivenModel | None = None,
    origin: Origin | None = None,
    watcher: ProgressCount = ignore_progress,
    tolerances: TolerancesFile | None = None,
) -> WrittenReport:
    """Compares recordings with their models, and writes all files of the report.

    The same input gives the same bytes. Nothing is written before everything is computed.

    Parameters
    ----------
    recordings
        Recordings of strokes or static stages.
    out_dir
        Folder of the report, made where it does not exist.
    shaft
        How the simulated shaft turns, see `analysis.matched_simulation`.
    given
        A model to compare all recordings with; None for each recording's own nominal model.
    origin
        Command, recordings and version for the foot of the pages.
    watcher
        Progress callback: number of conditions done, number of conditions.
    tolerances
        How near the model must be; without it nothing is tested.

    Raises
    ------
    BadInput
        Where nominal values do not make a model.
    SimulationFailed
        Where a stroke cannot be simulated.
    RigError
        Where a file cannot be written.
    """
    page_origin = origin or origin_in_memory(recordings)
    sources = compare_sources(recordings, shaft, given, watcher)
    table = Table2(tuple(row for source in sources for row in source.rows))
    run_sources = _name_run_pages(sources)
    run_links = []
    for name, source in run_sources.items():
        words = "How the run went"
        if len(run_sources) > 1:
            words = f"How {source.name} went"
        run_links.append(PageLink(name, words))
    page_links = find_pages(out_dir, page_origin, ("report.html", "run.html"))
    runs = {
        name: _run(name, source, page_origin, index, page_links)
        for index, (name, source) in enumerate(run_sources.items())
    }
    model_file = None
    if given is not None:
        model_file = given.file
    shown = as_table(table, SHAFT_WORDS[shaft])
    peaks = tuple(row for source in sources for row in source.peaks)
    shown_peaks = peaks_as_table(peaks, SHAFT_WORDS[shaft])
    tests = None
    accepted_files = {}
    if tolerances is not None:
        compared = [(source.name, condition) for source, condition in _list_compared(sources)]
        tests = run_acceptance_tests(compared, table.rows, tolerances)
        accepted_files = {
            **table_files((make_acceptance_table(tests),)),
            "acceptance.json": acceptance_json(tests),
        }
    contents = {
        "report.html": page(
            sources,
            table,
            shown_peaks,
            shaft,
            PageContext(page_origin, (*run_links, *page_links), model_file),
            tests,
        ),
        **accepted_files,
        **table_files((shown, shown_peaks)),
        "table2.json": as_json(table),
        "peak-forces.json": peaks_as_json(peaks),
        **{
            _name_traces(number_of): trace_csv(compared)
            for number_of, (_, compared) in enumerate(_list_compared(sources), start=1)
        },
    }
    write_all(
        out_dir,
        {**contents, **{name: text for files in runs.values() for name, text in files.items()}},
    )
    pages = tuple(out_dir / name for name in ("report.html", *runs))
    return WrittenReport(table, pages, tests)


def _run(
    name: str, source: ComparedSource, origin: Origin, index: int, page_links: tuple[PageLink, ...]
) -> dict[str, str]:
    """The page on one run and its tables, by file name."""
    story = story_of(source.recording)
    tables = tables_of(story)
    written = [*tables, *stage_tables(source.name, source.recording.static)]
    # The page's stem stands before the names of its tables, as in run-2-stages.
    stem = name.removesuffix(".html")
    # Empty tables are left out: static stages, strokes and cycles have different ones.
    files = table_files(
        replace(table, name=f"{stem}-{table.name}") for table in written if table.rows
    )
    run_origin = replace(origin, recordings=origin.recordings[index : index + 1])
    links = (PageLink("report.html", "Compared with the model"), *page_links)
    return {name: run_page(story, tables, PageContext(run_origin, links), tuple(files)), **files}
