"""Writes the files of a report into its folder."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.report.table import Table
from rfca_rig.report.table_files import as_csv, as_tex


def write_all(out: Path, contents: Mapping[str, str]) -> None:
    """Writes texts by their file names; `out` is made where it does not exist. Raises RigError where a file cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{out}: the folder for the report cannot be made: {error.strerror}; give another with --out") from None
    for name, text in contents.items():
        write_atomically(out / name, text.encode("utf-8"))


def table_files(tables: Iterable[Table]) -> dict[str, str]:
    """CSV and LaTeX of each table, by file name.

    A table without rows is written too: otherwise the file of an earlier report would remain beside the page.
    """
    each = (((f"{table.name}.csv", as_csv(table)), (f"{table.name}.tex", as_tex(table))) for table in tables)
    return {name: text for pair in each for name, text in pair}
