"""All files of a report into its folder."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.report.table import Table
from rfca_rig.report.table_files import as_csv, as_tex


def write_all(out: Path, contents: Mapping[str, str]) -> None:
    """Texts by their names; the folder is made where it is not there. Raises RigError where the disk refuses."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{out}: the folder for the report cannot be made: {error.strerror}; give another with --out") from None
    for name, text in contents.items():
        write_atomically(out / name, text.encode("utf-8"))


def table_files(tables: Iterable[Table]) -> dict[str, str]:
    """CSV and LaTeX of each, by their names; also of one without rows, lest that of an earlier report stay beside the page."""
    each = (((f"{table.name}.csv", as_csv(table)), (f"{table.name}.tex", as_tex(table))) for table in tables)
    return {name: text for pair in each for name, text in pair}
