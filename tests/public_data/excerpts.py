"""Source files, rebuilt from excerpts of them that have fewer columns and digits.

The folder RFCA_RIG_DATASETS_EXCERPTS has excerpts of most source files as CSV. Written back in the
form of the source they take the same way through readers and converters. Their SHA-256 differs,
except for `free-swing`, whose excerpts are complete.
"""

import csv
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest

VARIABLE = "RFCA_RIG_DATASETS_EXCERPTS"
SIMPLE = {
    "results/control_method_ddp/data_measured.csv": "sp_ddp_measured.csv",
    "results/control_method_direct_collocation/data_measured.csv": "sp_dircol_measured.csv",
    "results/control_method_energy_shaping/data_measured.csv": (
        "sp_energy_shaping_0.5kg_measured.csv"
    ),
    "results/control_method_energy_shaping/data_measured_1kg.csv": (
        "sp_energy_shaping_1kg_measured.csv"
    ),
    "results/control_method_ilqr/data_measured.csv": "sp_ilqr_measured.csv",
    "results/control_method_sac/data_measured.csv": "sp_sac_measured.csv",
    "results/control_method_pd/system_identification/data_measured.csv": "sp_sysid_measured.csv",
}
# Of the hopper, by the end of the source file's name.
STREAMS = {
    "ati_force.dat": ("Fx_N", "Fy_N", "Fz_N"),
    "joint_positions.dat": ("q_hfe_rad", "q_kfe_rad"),
    "joint_torques.dat": ("tau_hfe_Nm", "tau_kfe_Nm"),
    "height_sensors.dat": ("height_m",),
}
FIRST_INDEX = 107949
SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
    "<sheetData>{rows}</sheetData></worksheet>"
)
WORKBOOK = (
    '<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" '
    'xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships">'
    "<sheets>{sheets}</sheets></workbook>"
)
RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    "{relations}</Relationships>"
)


def excerpts_folder() -> Path:
    """The folder of excerpts; the test is skipped where the variable is not set."""
    stated = os.environ.get(VARIABLE)
    if not stated:
        pytest.skip(f"{VARIABLE} is not set: no excerpts of the source files")
    return Path(stated)


def rebuild(path: str, target: Path) -> None:
    """Write a source file, named by its path in the repository, in the form of the source."""
    excerpts = excerpts_folder()
    target.parent.mkdir(parents=True, exist_ok=True)
    _choose_writer(path)(excerpts, path, target)


def _choose_writer(path: str) -> Callable[[Path, str, Path], None]:
    writers = {
        "results/": _copy_simple,
        "data/experiment_records/": _copy_double,
        "leaderboard/": _copy_acrobot,
        "software/modelling/": _write_free_swing,
        "software/quanser_updated/": _write_flexible_link,
        "config/": _write_stream,
        "data/Ball": _write_workbook,
    }
    for beginning, writer in writers.items():
        if path.startswith(beginning):
            return writer
    pytest.skip(f"there is no excerpt of {path}")


def _copy_simple(excerpts: Path, path: str, target: Path) -> None:
    target.write_bytes((excerpts / "dfki-pendulum" / SIMPLE[path]).read_bytes())


def _copy_double(excerpts: Path, path: str, target: Path) -> None:
    time = path.rpartition("/trajectory.csv")[0].rpartition("-")[2]
    target.write_bytes((excerpts / "dfki-pendulum" / f"dp_C1_sysid_{time}.csv").read_bytes())


def _copy_acrobot(excerpts: Path, path: str, target: Path) -> None:
    number = path.partition("experiment")[2][:2]
    name = f"dp_C1_acrobot_mcpilco_rep{number}.csv"
    target.write_bytes((excerpts / "dfki-pendulum" / name).read_bytes())


def _write_free_swing(excerpts: Path, path: str, target: Path) -> None:
    degrees = {"01": 90, "02": 135, "03": 45}[path[-6:-4]]
    name = f"practice/free_swing_pendulum/release_{degrees}deg.csv"
    lines = ["trigger_start_deg, sample_rate, duration_sec", f"{degrees}, 1000, 5 "]
    lines += [f"{float(row['angle_reported_deg']):.2f}" for row in _rows_of(excerpts / name)]
    target.write_text("\n".join(lines) + "\n", newline="\n")


def _write_flexible_link(excerpts: Path, path: str, target: Path) -> None:
    from scipy.io import savemat

    name = "practice/flexible_link_2dsfl/lqr_square_both_stages_with_current.csv"
    rows = _rows_of(excerpts / name)
    variables = {
        "data_th11": ("time_s", "hub1_ref_deg", "hub1_angle_meas_deg"),
        "data_Im1": ("time_s", "motor1_current_cmd_A", "motor1_current_meas_A"),
    }
    arrays = {
        variable: np.array([[float(row[column]) for column in columns] for row in rows])
        for variable, columns in variables.items()
    }
    savemat(target, arrays)


def _write_stream(excerpts: Path, path: str, target: Path) -> None:
    columns = STREAMS[path.rpartition("-")[2]]
    lines = []
    for number, row in enumerate(_rows_of(excerpts / "hopper-teststand/hop_3s.csv")):
        values = "\t".join(row[column] for column in columns)
        lines.append(f"{FIRST_INDEX + number}\t\t{values}")
    target.write_text("\n".join(lines) + "\n", newline="\n")


def _write_workbook(excerpts: Path, path: str, target: Path) -> None:
    sheets: dict[str, list[list[str]]] = {}
    for row in _rows_of(excerpts / "ball-drops/ball_drops.csv"):
        cells = [row["drop"], row["t_s"], row["height_m"], row["velocity_m_s"]]
        sheets.setdefault(row["ball"], []).append(cells)
    write_workbook(target, sheets)


def write_workbook(target: Path, sheets: dict[str, list[list[str]]]) -> None:
    """Write a workbook with a line of names and these rows of numbers in each sheet."""
    relation_type = "http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet"
    entries = []
    relations = []
    with zipfile.ZipFile(target, "w") as archive:
        for number, (title, rows) in enumerate(sheets.items(), start=1):
            entries.append(f'<sheet name="{escape(title)}" sheetId="{number}" r:id="r{number}"/>')
            relations.append(
                f'<Relationship Id="r{number}" Type="{relation_type}" '
                f'Target="worksheets/sheet{number}.xml"/>'
            )
            names = ("Drop #", "Time (s)", "Height (m)", "Velocity (m/s)")
            head = "".join(f'<c t="inlineStr"><is><t>{name}</t></is></c>' for name in names)
            body = [f"<row>{head}</row>"]
            for row in rows:
                body.append("<row>" + "".join(f"<c><v>{cell}</v></c>" for cell in row) + "</row>")
            archive.writestr(f"xl/worksheets/sheet{number}.xml", SHEET.format(rows="".join(body)))
        archive.writestr("xl/workbook.xml", WORKBOOK.format(sheets="".join(entries)))
        archive.writestr(
            "xl/_rels/workbook.xml.rels", RELATIONS.format(relations="".join(relations))
        )


def _rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
