"""Files of data loggers, written by the packages of their makers and users."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign import logger_files
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import list_columns, read_columns
from rfca_rig.errors import BadInput

SAMPLES = 50
T_S = 0.01 * np.arange(SAMPLES)
ANGLE = np.sin(30.0 * T_S)
TORQUE = 5.0 * np.cos(20.0 * T_S)


def read(path, time, angle, torque):
    holds = {angle: "the position of joint elbow", torque: "the command of motor"}
    request = ColumnRequest(TimeSection(column=time, unit="s"), holds, 0.05)
    recording = read_columns(path, request)
    assert recording.t_s == pytest.approx(T_S, abs=1e-9)
    assert recording.values[angle] == pytest.approx(ANGLE, abs=1e-6)
    assert recording.values[torque] == pytest.approx(TORQUE, abs=1e-6)
    assert time in list_columns(path).times
    return recording


@pytest.mark.parametrize("has_waveforms", [False, True])
def test_tdms(tmp_path, has_waveforms):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "run.tdms"
    waveform = {}
    if has_waveforms:
        waveform = {"wf_increment": 0.01, "wf_start_offset": 0.0, "wf_samples": SAMPLES}
    columns = {"t": (T_S, "s"), "angle": (ANGLE, "rad"), "torque": (TORQUE, "Nm")}
    channels = [
        nptdms.ChannelObject("log", name, values, {"unit_string": unit, **waveform})
        for name, (values, unit) in columns.items()
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
    time = "log/angle.time" if has_waveforms else "log/t"
    recording = read(path, time, "log/angle", "log/torque")
    assert recording.units["log/torque"] == "Nm"


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_mdf(tmp_path, version):
    asammdf = pytest.importorskip("asammdf")
    suffix = ".mf4" if version == "4.10" else ".mdf"
    path = tmp_path / f"run{suffix}"
    with asammdf.MDF(version=version) as file:
        file.append(
            [
                asammdf.Signal(ANGLE, T_S, unit="rad", name="angle"),
                asammdf.Signal(TORQUE, T_S, unit="Nm", name="torque"),
            ]
        )
        file.save(path)
    recording = read(path, "0/time", "0/angle", "0/torque")
    assert recording.units["0/angle"] == "rad"


def test_counts_of_an_mdf_are_converted_by_its_own_rule(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    counts = np.round(ANGLE / 1e-6).astype(np.int32)
    path = tmp_path / "run.mf4"
    with asammdf.MDF(version="4.10") as file:
        signal = asammdf.Signal(
            counts, T_S, unit="rad", name="angle", conversion={"a": 1e-6, "b": 0.0}
        )
        file.append([signal, asammdf.Signal(TORQUE, T_S, unit="Nm", name="torque")])
        file.save(path)
    read(path, "0/time", "0/angle", "0/torque")


@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_a_table_of_arrow_with_lists_as_lerobot_writes_them(tmp_path, kind):
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table(
        {
            "timestamp": pyarrow.array(T_S),
            "observation.state": pyarrow.array(np.column_stack([ANGLE, ANGLE]).tolist()),
            "action": pyarrow.array(TORQUE),
            "task": pyarrow.array(["lift"] * SAMPLES),
        }
    )
    path = tmp_path / f"episode_000000.{kind}"
    if kind == "parquet":
        from pyarrow import parquet

        parquet.write_table(table, path)
    else:
        from pyarrow import feather

        feather.write_feather(table, path)
    read(path, "timestamp", "observation.state[1]", "action")


@pytest.mark.parametrize(
    ("name", "beginning", "module"),
    [
        ("run.tdms", b"TDSm", "nptdms"),
        ("run.mf4", b"MDF     4.10", "asammdf"),
        ("run.parquet", b"PAR1", "pyarrow"),
    ],
)
def test_a_missing_package_is_named_with_what_to_type(
    tmp_path: Path, monkeypatch, name, beginning, module
):
    monkeypatch.setattr(logger_files, "find_spec", lambda _: None)
    path = tmp_path / name
    path.write_bytes(beginning + bytes(600))
    with pytest.raises(BadInput, match=rf"{module}, which reads it, is not installed: pip install"):
        list_columns(path)


@pytest.mark.parametrize("module", ["asammdf", "pyarrow"])
def test_a_damaged_file_is_one_line(tmp_path, module):
    pytest.importorskip(module)
    beginning = {"asammdf": b"MDF     4.10    ", "pyarrow": b"PAR1"}[module]
    path = tmp_path / "run.bin"
    path.write_bytes(beginning + bytes(range(256)) * 4)
    with pytest.raises(BadInput) as refused:
        list_columns(path)
    assert str(refused.value).startswith(f"{path}: cannot be read as a ")
    assert "\n" not in str(refused.value)
