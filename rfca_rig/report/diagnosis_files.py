"""Writes the two files of a diagnosis: diagnosis.json for programs, diagnosis.html for people."""

from pathlib import Path

from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.report.diagnosis_json import as_json
from rfca_rig.report.diagnosis_page import page
from rfca_rig.report.diagnosis_terminal import terminal_lines

__all__ = ["terminal_lines", "write_diagnosis"]


def write_diagnosis(diagnosis: Diagnosis, out: Path) -> None:
    """Both files into `out`, made where it is not there; the same bytes for the same diagnosis. Raises RigError where the disk refuses."""
    contents = {"diagnosis.json": as_json(diagnosis), "diagnosis.html": page(diagnosis)}
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{out}: the folder for the diagnosis cannot be made: {error.strerror}; give another with --out") from None
    for name, text in contents.items():
        write_atomically(out / name, text.encode("utf-8"))
