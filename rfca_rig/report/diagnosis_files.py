"""Writes the files of a diagnosis: diagnosis.json for programs, diagnosis.html for people, tables as CSV and LaTeX for papers."""

from pathlib import Path

from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.report.diagnosis_json import as_json
from rfca_rig.report.diagnosis_page import page
from rfca_rig.report.diagnosis_tables import before_after_table, detection_limits_table, nominal_values_table, parameters_table
from rfca_rig.report.diagnosis_terminal import terminal_lines
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.provenance import Origin

__all__ = ["terminal_lines", "write_diagnosis"]


def write_diagnosis(diagnosis: Diagnosis, out: Path, origin: Origin | None = None) -> None:
    """Writes all files of a diagnosis into `out`, which is made where it does not exist. The same diagnosis gives the same bytes.

    Parameters
    ----------
    diagnosis
        The result to write.
    out
        Folder of the report.
    origin
        Command, recordings and version for the foot of the page; None for a page that no command made.

    Raises
    ------
    RigError
        Where a file cannot be written.
    """
    tables = (
        parameters_table(diagnosis),
        nominal_values_table(diagnosis),
        detection_limits_table(diagnosis),
        before_after_table(diagnosis),
    )
    contents = {"diagnosis.json": as_json(diagnosis), **table_files(tables)}
    write_all(out, {"diagnosis.html": page(diagnosis, origin or Origin(), tuple(contents)), **contents})
