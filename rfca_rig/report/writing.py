"""Writes the report of some recordings: report.html, table2.csv, table2.tex, table2.json."""

from collections.abc import Sequence
from pathlib import Path

from rfca_rig.analysis.counterpart import Shaft
from rfca_rig.analysis.table2 import Table2
from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.form import Recording
from rfca_rig.report.page import page
from rfca_rig.report.sources import GivenModel, compare_sources
from rfca_rig.report.table2_files import as_csv, as_json, as_tex


def write_report(recordings: Sequence[Recording], out_dir: Path, shaft: Shaft = "average", given: GivenModel | None = None) -> Table2:
    """Compares, draws, and writes the four files into `out_dir`, which is made where it is not there; returns the table.

    Every recording is held against the model it was believed to follow, or all against the `given` one. `shaft` says how the
    simulated shaft turns, see `analysis.counterpart`. The same input gives the same bytes. Nothing is written before everything is
    computed. Raises BadInput, SimulationFailed, and RigError where the disk refuses.
    """
    sources = compare_sources(recordings, shaft, given)
    table = Table2(tuple(row for source in sources for row in source.rows))
    contents = {
        "report.html": page(sources, table, shaft, None if given is None else given.file),
        "table2.csv": as_csv(table),
        "table2.tex": as_tex(table),
        "table2.json": as_json(table),
    }
    _make_folder(out_dir)
    for name, text in contents.items():
        write_atomically(out_dir / name, text.encode("utf-8"))
    return table


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{folder}: the folder for the report cannot be made: {error.strerror}; give another with --out") from None
