"""CSV read back, value by value."""

import csv
import errno
import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput, DiskFull
from rfca_rig.export import csv_files
from rfca_rig.export.csv_files import export_csv
from rfca_rig.progress import ignore_progress
from rfca_rig.recording.store import write_recording
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.export.recordings import recording


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_value_is_there_to_the_last_digit_and_the_index_lists_all(tmp_path):
    known = recording()
    write_recording(known, tmp_path / "run.h5")
    told = []
    exported = export_csv(tmp_path, tmp_path / "out", lambda done, of: told.append((done, of)))
    index = rows(tmp_path / "out/stages.csv")
    stages = [
        *(stroke.streams for stroke in known.strokes),
        *(stage.streams for stage in known.raw),
    ]
    wanted = [
        (stage, name, stream)
        for stage, streams in enumerate(stages, start=1)
        for name, stream in streams.items()
    ]
    assert [(row["file"], int(row["records"])) for row in index] == [
        (f"stages/{stage:03d}-{name}.csv", len(stream.t_s)) for stage, name, stream in wanted
    ]
    for row, (_, _, stream) in zip(index, wanted, strict=True):
        table = rows(tmp_path / "out" / row["file"])
        assert [float(record["t_s"]) for record in table] == stream.t_s.tolist()
        for name, column in stream.columns.items():
            assert np.array_equal([float(record[name]) for record in table], column.values), name
    assert (index[0]["height_mm"], index[0]["speed_rad_s"], index[-1]["cut_short"]) == (
        "215.0",
        "2.433",
        "TRIP L-01",
    )
    assert exported.files == len(index)
    assert told[-1] == (4, 4)


def test_static_stages_have_a_table_of_their_own(tmp_path):
    write_recording(recording(140), tmp_path / "run.h5")
    export_csv(tmp_path / "run.h5", tmp_path / "out", ignore_progress)
    (held,) = rows(tmp_path / "out/static.csv")
    assert (held["direction"], float(held["fz_N"]), held["hinge7_deg"]) == ("loading", -2.36, "nan")


def test_a_folder_that_is_there_is_left_alone(tmp_path):
    write_recording(recording(140), tmp_path / "run.h5")
    (tmp_path / "out").mkdir()
    with pytest.raises(BadInput, match="is there already"):
        export_csv(tmp_path, tmp_path / "out", ignore_progress)


def test_a_run_that_was_never_put_together_is_exported_from_its_stages(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, recorder, kept):
        run_plan(one_condition(twin_rig()), bench, recorder, nothing)
        kept.finish()
    export_csv(tmp_path / "run", tmp_path / "whole", ignore_progress)
    (tmp_path / "run" / "run.h5").unlink()
    export_csv(tmp_path / "run", tmp_path / "stages", ignore_progress)
    files = sorted(
        path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*.csv")
    )
    assert len(files) > 2
    assert [(tmp_path / "stages" / file).read_bytes() for file in files] == [
        (tmp_path / "whole" / file).read_bytes() for file in files
    ]


def test_damage_in_the_recording_is_not_blamed_on_the_disk(tmp_path):
    path = write_recording(recording(140), tmp_path / "run.h5")
    # Without its checksum, as a file of an older version.
    os.truncate(path, path.stat().st_size - 41)
    with h5py.File(path, "r+") as file:
        del file.attrs["sealed"]
        file["strokes/001/force/fz_N"].id.write_direct_chunk((0,), b"no deflated bytes")
    with pytest.raises(BadInput, match=r"run\.h5: is not a whole recording"):
        export_csv(path, tmp_path / "out", ignore_progress)
    assert not (tmp_path / "out").exists()


def test_a_disk_that_refuses_is_named(tmp_path, monkeypatch):
    def refuse(*_) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = write_recording(recording(140), tmp_path / "run.h5")
    monkeypatch.setattr(csv_files, "_write_csv", refuse)
    with pytest.raises(DiskFull, match="out: cannot be written: No space left on device"):
        export_csv(path, tmp_path / "out", ignore_progress)


def test_a_device_whose_name_is_a_path_becomes_a_file_of_its_stage(tmp_path):
    known = recording(140)
    stroke = known.strokes[0]
    path = write_recording(
        replace(known, strokes=(replace(stroke, streams={"../../x": stroke.streams["force"]}),)),
        tmp_path / "run.h5",
    )
    export_csv(path, tmp_path / "deep" / "out", ignore_progress)
    assert (tmp_path / "deep" / "out" / "stages" / "001-.._.._x.csv").is_file()
