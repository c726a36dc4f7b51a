import dataclasses
import errno
import math
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording import atomic
from rfca_rig.recording.hdf5_file import SEALED
from rfca_rig.recording.model import Column, Stream, Stroke
from rfca_rig.recording.store import read_recording, write_recording
from tests.recording.same import assert_same
from tests.recording.samples import recording, stroke


def test_a_recording_comes_back_as_it_was(tmp_path: Path):
    written = recording()
    assert_same(read_recording(write_recording(written, tmp_path / "run.h5")), written)


def test_a_recording_without_strokes_stages_or_samples_comes_back(tmp_path: Path):
    empty = Stroke(
        0.2,
        3.0,
        1,
        {"force": Stream(np.array([]), {"fz_N": Column(np.array([], dtype=np.int32), "N")})},
    )
    for written in (recording(0, 0), dataclasses.replace(recording(0, 0), strokes=(empty,))):
        assert_same(read_recording(write_recording(written, tmp_path / "run.h5")), written)


def test_the_same_recording_gives_the_same_bytes(tmp_path: Path):
    one = write_recording(recording(), tmp_path / "one.h5")
    two = write_recording(recording(), tmp_path / "two.h5")
    assert one.read_bytes() == two.read_bytes()
    with h5py.File(one) as file:
        file.visititems(_assert_no_time_of_writing)


def _assert_no_time_of_writing(_: str, item: h5py.Group | h5py.Dataset) -> None:
    assert h5py.h5o.get_info(item.id).ctime == 0


def test_who_reads_while_a_file_is_replaced_sees_the_old_one_whole(tmp_path: Path):
    path = write_recording(recording(1), tmp_path / "run.h5")
    with path.open("rb") as reader:
        before = path.read_bytes()
        write_recording(recording(2), path)
        assert reader.read() == before


@pytest.mark.long
def test_more_than_999_strokes_keep_their_order(tmp_path: Path):
    times = Stream(np.array([0.0]), {})
    written = dataclasses.replace(
        recording(0, 0),
        strokes=tuple(Stroke(0.2, 3.0, k, {"force": times}) for k in range(1, 1003)),
    )
    assert [
        found.repeat
        for found in read_recording(write_recording(written, tmp_path / "run.h5")).strokes
    ] == list(range(1, 1003))


def test_a_height_written_in_mm_stays_that_number(tmp_path: Path):
    """Also one that 1e3 * (mm / 1e3) does not give back, such as 254.3."""
    heights_mm = [215.0, 254.3]
    strokes = tuple(
        dataclasses.replace(stroke(1, 2), height_m=height_mm / 1e3) for height_mm in heights_mm
    )
    path = write_recording(
        dataclasses.replace(recording(0, 0), strokes=strokes), tmp_path / "run.h5"
    )
    assert [found.height_m for found in read_recording(path).strokes] == [
        height_mm / 1e3 for height_mm in heights_mm
    ]
    with h5py.File(path) as file:
        assert [group.attrs["height_mm"] for group in file["strokes"].values()] == heights_mm


@pytest.mark.parametrize(
    "name", ["speed_m/s", "/fz_N", "a//b", "a%2Fb", ".", "..", "Kraft (µN)", "a b"]
)
def test_any_column_name_survives(tmp_path: Path, name: str):
    stream = Stream(np.array([0.0, 1.0]), {name: Column(np.array([3.0, 4.0]), "")})
    written = dataclasses.replace(
        recording(0, 0), strokes=(Stroke(0.2, 3.0, 1, {"table": stream}),)
    )
    path = write_recording(written, tmp_path / "run.h5")
    assert_same(read_recording(path), written)
    with h5py.File(path) as file:
        assert {type(file["strokes/001/table"][found]) for found in file["strokes/001/table"]} == {
            h5py.Dataset
        }


def test_other_programs_find_time_units_and_values(tmp_path: Path):
    with h5py.File(write_recording(recording(), tmp_path / "run.h5")) as file:
        fz = file["strokes/001/force/fz_N"]
        assert fz.dims[0][0] == file["strokes/001/force/t_s"]
        assert (fz.dtype, fz.attrs["units"]) == (np.float64, "N")
        expected = recording().strokes[0].streams["force"].columns["fz_N"]
        np.testing.assert_array_equal(fz[:], expected.values)
        # Nothing that another program could multiply the values with once more.
        assert not {"conversion", "offset", "scale_factor", "add_offset"} & set(fz.attrs)
        assert (fz.compression, fz.compression_opts, fz.shuffle) == ("gzip", 1, True)
        assert file["strokes/001/force/t_s"].attrs["units"] == "s"
        assert file.attrs["source"] == file["strokes/001/force"].attrs["source"] == "SIM"
        assert "t_s" not in file


def test_columns_that_are_not_rows_of_numbers_are_refused_and_nothing_is_left(tmp_path: Path):
    t_s = np.array([0.0, 1.0])
    for data in (np.array(["a", "b"]), np.zeros((2, 2)), np.zeros(3)):
        bad = Stroke(0.2, 3.0, 1, {"force": Stream(t_s, {"fz_N": Column(data, "N")})})
        with pytest.raises(ValueError, match="fz_N"):
            write_recording(
                dataclasses.replace(recording(0, 0), strokes=(bad,)), tmp_path / "run.h5"
            )
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_file_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = write_recording(recording(1), tmp_path / "run.h5")
    before = path.read_bytes()
    monkeypatch.setattr(atomic.os, "fsync", _full_disk)
    with pytest.raises(
        RigError, match=r"run\.h5: .* MB cannot be written: No space left on device"
    ):
        write_recording(recording(2), path)
    assert path.read_bytes() == before
    assert [found.name for found in tmp_path.iterdir()] == ["run.h5"]


def _full_disk(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def refusal(path: Path) -> str:
    with pytest.raises(BadInput) as caught:
        read_recording(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    return said


def test_a_file_cut_short_is_one_line(tmp_path: Path):
    content = write_recording(recording(), tmp_path / "whole.h5").read_bytes()
    for kept in (0, 7, 100, 5000, len(content) // 2, len(content) - 100):
        (tmp_path / "cut.h5").write_bytes(content[:kept])
        assert "not a whole recording" in refusal(tmp_path / "cut.h5")


def test_a_single_flipped_bit_is_noticed(tmp_path: Path):
    content = write_recording(recording(), tmp_path / "whole.h5").read_bytes()
    for place in np.random.default_rng(3).integers(0, len(content) - 41, 50):
        damaged = bytearray(content)
        damaged[place] ^= 1
        (tmp_path / "flipped.h5").write_bytes(damaged)
        assert "checksum" in refusal(tmp_path / "flipped.h5")


def test_a_file_that_another_program_edited_is_refused(tmp_path: Path):
    path = write_recording(recording(), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["note"] = "checked by hand"
    assert "its checksum is gone from its end, so it was changed after it was written" in refusal(
        path
    )


def test_a_file_from_before_files_stated_that_they_are_sealed_still_opens(tmp_path: Path):
    path = write_recording(recording(), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        del file.attrs[SEALED]
    assert_same(read_recording(path), recording())


def test_files_of_another_kind_are_refused(tmp_path: Path):
    (tmp_path / "text.h5").write_text("t_s,fz_N\n")
    assert "not a whole recording" in refusal(tmp_path / "text.h5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = 1
    assert "without format attribute" in refusal(tmp_path / "foreign.h5")
    with h5py.File(tmp_path / "newer.h5", "w") as file:
        file.attrs["format"] = "rfca-recording/3"
    assert (
        "'rfca-recording/3', where a recording of format 'rfca-recording/2' is needed"
        in refusal(tmp_path / "newer.h5")
    )
    assert "is not there" in refusal(tmp_path / "absent.h5")


@pytest.mark.parametrize("gone", ["provenance", "strokes", "strokes/001/force/fz_N", "static/fz_N"])
def test_a_recording_with_a_part_missing_is_refused(tmp_path: Path, gone: str):
    path = write_recording(recording(), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        del file[gone], file.attrs[SEALED]
    assert "not a whole recording" in refusal(path)


def test_a_simulated_stream_in_a_real_recording_is_refused(tmp_path: Path):
    path = write_recording(dataclasses.replace(recording(), source="REAL"), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        file["strokes/002/force"].attrs["source"] = "SIM"
        del file.attrs[SEALED]
    assert "/strokes/002/force is marked SIM in a recording marked REAL" in refusal(path)


def test_a_file_from_before_there_were_photos_still_opens(tmp_path: Path):
    path = write_recording(recording(), tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        for name in [
            name
            for name in file["static"]
            if "std_deg" in name or name.startswith("photo") or name == "overlay"
        ]:
            del file["static"][name]
        del file.attrs[SEALED]
    found = read_recording(path).static
    given = recording().static
    assert repr([stage.hinge_deg for stage in found]) == repr([stage.hinge_deg for stage in given])
    assert all(math.isnan(std) for stage in found for std in stage.hinge_std_deg)
    assert all(math.isnan(std) for stage in found for std in stage.hinge_reading_std_deg)
    assert {len(stage.hinge_std_deg) for stage in found} == {6}
    assert {(stage.photo, stage.overlay, stage.photo_doubts) for stage in found} == {("", "", "")}
