"""Writes the files of a diagnosis: diagnosis.json for programs, diagnosis.html for people, tables as CSV and LaTeX for papers."""

from pathlib import Path

from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.report.diagnosis_json import as_json
from rfca_rig.report.diagnosis_page import page
from rfca_rig.report.diagnosis_tables import before_after_table, nominal_values_table, parameters_table, ruled_out_table
from rfca_rig.report.diagnosis_terminal import terminal_lines
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.provenance import Origin

__all__ = ["terminal_lines", "write_diagnosis"]


def write_diagnosis(diagnosis: Diagnosis, out: Path, origin: Origin | None = None) -> None:
    """All files into `out`, made where it is not there; the same bytes for the same diagnosis. Raises RigError where the disk refuses."""
    tables = (parameters_table(diagnosis), nominal_values_table(diagnosis), ruled_out_table(diagnosis), before_after_table(diagnosis))
    contents = {"diagnosis.json": as_json(diagnosis), **table_files(tables)}
    write_all(out, {"diagnosis.html": page(diagnosis, origin or Origin(), tuple(contents)), **contents})
