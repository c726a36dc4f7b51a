"""Recordings of the first format, which hold counts, are read and completed as the others are."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.campaign.stored import SamplesInFile
from rfca_rig.recording import run_folder
from rfca_rig.recording.columns import ColumnForm
from rfca_rig.recording.layout import stage_files
from rfca_rig.recording.model import Recording
from rfca_rig.recording.store import read_recording, summarize, write_recording
from tests.recording.first_format import turn_into_first_format
from tests.recording.growing import grown
from tests.recording.same import assert_same
from tests.recording.samples import recording


def rounded(known: Recording) -> Recording:
    """The recording with forces as whole counts give them: random doubles have no counts."""
    force_form = ColumnForm("", "<i4", "N", 1e-6)
    strokes = []
    for stroke in known.strokes:
        streams = {}
        for name, stream in stroke.streams.items():
            columns = dict(stream.columns)
            for key, column in columns.items():
                if key.endswith(("_N", "_Nm")):
                    counts = np.round(column.values / 1e-6).astype(np.int32)
                    columns[key] = replace(column, data=force_form.values(counts))
            streams[name] = replace(stream, columns=columns)
        strokes.append(replace(stroke, streams=streams))
    return replace(known, strokes=tuple(strokes))


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = write_recording(rounded(recording()), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        turn_into_first_format(file)
        del file.attrs["sealed"]
    return path


def angles_apart(found: Recording, known: Recording) -> float:
    """In rad; the shift of the angle in the first format costs a rounding."""
    return max(
        np.max(
            np.abs(
                mine.streams["shaft"].columns["shaft_angle_rad"].values
                - its.streams["shaft"].columns["shaft_angle_rad"].values
            )
        )
        for mine, its in zip(found.strokes, known.strokes, strict=True)
    )


def without_angles(known: Recording) -> Recording:
    strokes = []
    for stroke in known.strokes:
        shaft = stroke.streams["shaft"]
        columns = {key: column for key, column in shaft.columns.items() if "angle" not in key}
        streams = {**stroke.streams, "shaft": replace(shaft, columns=columns)}
        strokes.append(replace(stroke, streams=streams))
    return replace(known, strokes=tuple(strokes))


def test_counts_are_read_as_values_and_the_host_keeps_the_clock_of_the_run(old: Path):
    known = rounded(recording())
    found = read_recording(old)
    assert angles_apart(found, known) < 1e-14
    assert_same(without_angles(found), without_angles(known))


def test_a_stage_that_is_read_in_blocks_has_the_same_values(old: Path):
    known = read_recording(old).strokes[0].streams
    with h5py.File(old) as file:
        samples = SamplesInFile.of(old, file, "strokes/001")
    with samples.open_streams() as streams:
        for stream in streams:
            for name, column in stream.columns.items():
                np.testing.assert_array_equal(
                    column.values(slice(None)), known[stream.name].columns[name].data
                )


def test_a_run_with_stages_of_both_formats_is_put_together_in_values(tmp_path: Path):
    grown(tmp_path / "run", 3).finish("done")
    run_folder.build_recording(tmp_path / "run")
    known = read_recording(tmp_path / "run" / "run.h5")
    with h5py.File(stage_files(tmp_path / "run")[0], "r+") as file:
        turn_into_first_format(file)
        del file.attrs["sealed"]
    run_folder.build_recording(tmp_path / "run")
    found = read_recording(tmp_path / "run" / "run.h5")
    assert angles_apart(found, known) < 1e-14
    assert_same(without_angles(found), without_angles(known))
    with h5py.File(tmp_path / "run" / "run.h5") as file:
        force = file["strokes/001/force"]
        assert file.attrs["format"] == "rfca-recording/2"
        assert force["fz_N"].dtype == np.float64
        assert force["fz_N"].dims[0][0] == force["t_s"]
        assert "conversion" not in force["fz_N"].attrs
    assert summarize(tmp_path / "run" / "run.h5").strokes == 2


@pytest.mark.parametrize("conversion", [1e-6, 1.0 / 1_000_000, 1.0 / 3.0, 2.5e-4, -1e-6, 7e5])
@pytest.mark.parametrize("offset", [0.0, 0.25])
def test_a_count_comes_back_from_its_value(conversion: float, offset: float):
    form = ColumnForm("fz_N", "<i4", "N", conversion, offset)
    counts = np.random.default_rng(1).integers(-(2**31), 2**31, 10_000).astype(np.int32)
    values = form.values(counts)
    np.testing.assert_array_equal(np.round((values - offset) / conversion), counts)
    exact = counts.astype(np.longdouble) * np.longdouble(conversion) + offset
    assert np.max(np.abs(values - exact)) <= abs(conversion) / 8


def test_values_of_counts_end_in_zeros():
    form = ColumnForm("fz_N", "<i4", "N", 1e-6)
    counts = np.random.default_rng(1).integers(-60_000_000, 60_000_000, 1000).astype(np.int32)
    bits = form.values(counts).view(np.uint64)
    assert not (bits & np.uint64(2**20 - 1)).any()
