"""Writes the report of recordings: report.html with Table II and the forces at the peak, and run.html on each run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rfca_rig.analysis.compare import Table2
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording.model import Recording
from rfca_rig.reports.provenance import Origin, PageContext, PageLink, find_pages, origin_in_memory
from rfca_rig.reports.run.page import page as run_page
from rfca_rig.reports.run.page import tables_of
from rfca_rig.reports.run.parts import story_of
from rfca_rig.reports.strokes.page import ComparedSource, GivenModel, compare_sources, page
from rfca_rig.reports.strokes.tables import as_json, as_table, peaks_as_json, peaks_as_table, stage_tables
from rfca_rig.reports.table import table_files, write_all
from rfca_rig.reports.text import SHAFT_WORDS


@dataclass(frozen=True)
class WrittenReport:
    """Table II, and the paths of the pages."""

    table: Table2
    pages: tuple[Path, ...]


def write_report(
    recordings: Sequence[Recording],
    out_dir: Path,
    shaft: Shaft = "average",
    given: GivenModel | None = None,
    origin: Origin | None = None,
    watcher: ProgressCount = ignore_progress,
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
    # One run has run.html, several have run-1.html, run-2.html.
    run_sources = [(f"run-{number}.html" if len(sources) > 1 else "run.html", source) for number, source in enumerate(sources, start=1)]
    found = find_pages(out_dir, page_origin, ("report.html", "run.html"))
    runs = {name: _run(name, source, page_origin, place, found) for place, (name, source) in enumerate(run_sources)}
    links = tuple(PageLink(name, f"How {source.name} went" if len(run_sources) > 1 else "How the run went") for name, source in run_sources)
    shown = as_table(table, SHAFT_WORDS[shaft])
    peaks = tuple(row for source in sources for row in source.peaks)
    shown_peaks = peaks_as_table(peaks, SHAFT_WORDS[shaft])
    contents = {
        "report.html": page(
            sources, table, shown_peaks, shaft, PageContext(page_origin, (*links, *found), None if given is None else given.file)
        ),
        **table_files((shown, shown_peaks)),
        "table2.json": as_json(table),
        "peak-forces.json": peaks_as_json(peaks),
    }
    write_all(out_dir, {**contents, **{name: text for files in runs.values() for name, text in files.items()}})
    return WrittenReport(table, tuple(out_dir / name for name in ("report.html", *runs)))


def _run(name: str, source: ComparedSource, origin: Origin, place: int, found: tuple[PageLink, ...]) -> dict[str, str]:
    """The page on one run and its tables, by file name."""
    story = story_of(source.recording)
    tables = tables_of(story)
    written = [*tables, *stage_tables(source.name, source.recording.static)]
    # Empty tables are left out: static stages, strokes and cycles have different ones.
    # The page's stem stands before the names of its tables, as in run-2-stages.
    stem = name.removesuffix(".html")
    files = table_files(replace(table, name=f"{stem}-{table.name}") for table in written if table.rows)
    own = replace(origin, recordings=origin.recordings[place : place + 1])
    links = (PageLink("report.html", "Compared with the model"), *found)
    return {name: run_page(story, tables, PageContext(own, links), tuple(files)), **files}
