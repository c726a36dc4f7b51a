"""Writes the report of some recordings: report.html with Table II and the forces at the peak, and a page about each run, run.html."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path
from typing import Any

from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.analysis.peak_force import PeakForceRow, PeakSpread
from rfca_rig.analysis.repeats import Condition
from rfca_rig.analysis.table2 import Table2
from rfca_rig.progress import Watcher, unwatched
from rfca_rig.recording.model import Recording
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.provenance import Origin, PageLink, Told, untold
from rfca_rig.report.run_page import page as run_page
from rfca_rig.report.run_page import tables_of
from rfca_rig.report.run_parts import story_of
from rfca_rig.report.sources import ComparedSource, GivenModel, compare_sources
from rfca_rig.report.stage_table import stage_tables
from rfca_rig.report.table import Foot, Table, TableColumn, TableRow
from rfca_rig.report.table2_files import as_json, as_table, rounded_or_none
from rfca_rig.report.table2_page import page
from rfca_rig.report.text import SHAFT_WORDS

FORMAT = "rfca-peak-forces/1"
MEASURED, SIMULATED = "Measured peak", "Simulated peak"
PAPER_CONDITION = Condition(0.155, 15.0, ())  # the paper's impact test, section IV.A
PAPER_PEAK_N = (188.0, 232.0)  # fy and fz there, printed without signs

COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("speed_rad_s", "Speed", set_value=True),
    TableColumn("repeats", "Repeats"),
    TableColumn("measured_force_N", "|F|", digits=1, half="measured_force_std_N", over=MEASURED),
    TableColumn("measured_force_std_N", role="kept"),
    TableColumn("measured_fy_N", "fy", digits=1, half="measured_fy_std_N", over=MEASURED),
    TableColumn("measured_fy_std_N", role="kept"),
    TableColumn("measured_fz_N", "fz", digits=1, half="measured_fz_std_N", over=MEASURED),
    TableColumn("measured_fz_std_N", role="kept"),
    TableColumn("measured_time_s", "time", digits=4, half="measured_time_std_s", over=MEASURED),
    TableColumn("measured_time_std_s", role="kept"),
    TableColumn("simulated_force_N", "|F|", digits=1, over=SIMULATED),
    TableColumn("simulated_fy_N", "fy", digits=1, over=SIMULATED),
    TableColumn("simulated_fz_N", "fz", digits=1, over=SIMULATED),
    TableColumn("simulated_time_s", "time", digits=4, over=SIMULATED),
    TableColumn("simulated_touching", role="kept"),
    TableColumn("shaft_speed_rad_s", role="kept"),
    TableColumn("source", role="group"),
    TableColumn("notes", role="note"),
)


def peaks_as_json(rows: Sequence[PeakForceRow]) -> str:
    """The document; what is not known is null."""
    document = {"format": FORMAT, "rows": [peak_record(row) for row in rows]}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def peaks_as_table(rows: Sequence[PeakForceRow], shaft_words: str) -> Table:
    """In the order of the paper's text, with its own peak below where a row has its condition. `shaft_words` as for Table II."""
    return Table(
        name="peak-forces",
        caption="Forces on the sensor at the instant when |F|, with |F|² = fy² + fz², is largest in the stroke. The instant is one sample. "
        "Measured: mean ± one standard deviation (n - 1) over the repeats. Simulated: "
        f"{shaft_words}. Time counts from the start of the motion.",
        columns=COLUMNS,
        rows=tuple(TableRow({**peak_record(row), "notes": "; ".join(_notes(row))}) for row in rows),
        foot=_foot(rows),
    )


def peak_record(row: PeakForceRow) -> dict[str, Any]:
    """The row by the keys of rfca-peak-forces/1."""
    return {
        "height_mm": rounded_or_none(1e3 * row.height_m, 3),
        "speed_rad_s": rounded_or_none(row.speed_rad_s, 5),
        "repeats": row.repeats,
        **_measured(row.measured),
        "simulated_force_N": rounded_or_none(row.simulated.force_N.mean, 4),
        "simulated_fy_N": rounded_or_none(row.simulated.fy_N.mean, 4),
        "simulated_fz_N": rounded_or_none(row.simulated.fz_N.mean, 4),
        "simulated_time_s": rounded_or_none(row.simulated.time_s.mean, 6),
        "simulated_touching": row.simulated_touching,
        "shaft_speed_rad_s": rounded_or_none(row.shaft_speed_rad_s, 5),
        "source": row.source,
        "refused": list(row.refused),
    }


def _measured(peaks: PeakSpread) -> dict[str, float | None]:
    return {
        "measured_force_N": rounded_or_none(peaks.force_N.mean, 4),
        "measured_force_std_N": rounded_or_none(peaks.force_N.std, 4),
        "measured_fy_N": rounded_or_none(peaks.fy_N.mean, 4),
        "measured_fy_std_N": rounded_or_none(peaks.fy_N.std, 4),
        "measured_fz_N": rounded_or_none(peaks.fz_N.mean, 4),
        "measured_fz_std_N": rounded_or_none(peaks.fz_N.std, 4),
        "measured_time_s": rounded_or_none(peaks.time_s.mean, 6),
        "measured_time_std_s": rounded_or_none(peaks.time_s.std, 6),
    }


def _notes(row: PeakForceRow) -> list[str]:
    """What a reader would take wrongly: the largest force of a fast stroke may be the pull of the leg in the air."""
    in_the_air = ["simulated: the leg is off the ground at its peak"] if row.simulated_touching is False else []
    return [*row.refused, *in_the_air]


def _foot(rows: Sequence[PeakForceRow]) -> tuple[Foot, ...]:
    if not any(PAPER_CONDITION.label == Condition(row.height_m, row.speed_rad_s, ()).label for row in rows):
        return ()
    fy_N, fz_N = PAPER_PEAK_N
    values = {"measured_force_N": hypot(fy_N, fz_N), "measured_fy_N": fy_N, "measured_fz_N": fz_N}
    return (Foot(f"The paper\u2019s own peak at {PAPER_CONDITION.label}, without signs", values, digits=0),)


@dataclass(frozen=True)
class WrittenReport:
    """The table, and the pages that were written."""

    table: Table2
    pages: tuple[Path, ...]


def write_report(
    recordings: Sequence[Recording],
    out_dir: Path,
    shaft: Shaft = "average",
    given: GivenModel | None = None,
    origin: Origin | None = None,
    watcher: Watcher = unwatched,
) -> WrittenReport:
    """Compares, draws, and writes all files into `out_dir`, which is made where it is not there.

    Every recording is held against the model it was believed to follow, or all against the `given` one. `shaft` says how the
    simulated shaft turns, see `analysis.matched_simulation`. The same input gives the same bytes. Nothing is written before everything is
    computed. Raises BadInput, SimulationFailed, and RigError where the disk refuses.
    """
    told = origin or untold(recordings)
    sources = compare_sources(recordings, shaft, given, watcher)
    table = Table2(tuple(row for source in sources for row in source.rows))
    named = _run_pages(sources)
    runs = {name: _run(name, source, told, place) for place, (name, source) in enumerate(named)}
    links = tuple(PageLink(name, f"How {source.name} went" if len(named) > 1 else "How the run went") for name, source in named)
    shown = as_table(table, SHAFT_WORDS[shaft])
    peaks = tuple(row for source in sources for row in source.peaks)
    shown_peaks = peaks_as_table(peaks, SHAFT_WORDS[shaft])
    contents = {
        "report.html": page(sources, table, shown_peaks, shaft, Told(told, links, None if given is None else given.file)),
        **table_files((shown, shown_peaks)),
        "table2.json": as_json(table),
        "peak-forces.json": peaks_as_json(peaks),
    }
    write_all(out_dir, {**contents, **{name: text for files in runs.values() for name, text in files.items()}})
    return WrittenReport(table, tuple(out_dir / name for name in ("report.html", *runs)))


def _run_pages(sources: Sequence[ComparedSource]) -> list[tuple[str, ComparedSource]]:
    """The name of each one's page: run, or, of several, run-1, run-2."""
    return [(f"run-{number}.html" if len(sources) > 1 else "run.html", source) for number, source in enumerate(sources, start=1)]


def _run(name: str, source: ComparedSource, origin: Origin, place: int) -> dict[str, str]:
    """The page about one run, with its tables."""
    story = story_of(source.recording)
    tables = tables_of(story)
    written = [*tables, *stage_tables(source.name, source.recording.static)]
    files = table_files(_named_for(name.removesuffix(".html"), table) for table in written if table.rows)
    own = replace(origin, recordings=origin.recordings[place : place + 1])
    return {name: run_page(story, tables, Told(own, (PageLink("report.html", "Held against the model"),)), tuple(files)), **files}


def _named_for(stem: str, table: Table) -> Table:
    """run-stages of the second of several pages is run-2-stages."""
    return replace(table, name=f"{stem}-{table.name}")
