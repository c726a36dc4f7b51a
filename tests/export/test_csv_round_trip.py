"""`export csv` and `import` are inverse to each other: everything that an analysis uses comes back
to the last digit, and what is imported stays an import.
"""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from typer.testing import CliRunner

from rfca_rig.campaign.opening import import_campaign, open_recordings
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.cli.main import app
from rfca_rig.errors import BadInput
from rfca_rig.export.csv_files import export_csv
from rfca_rig.progress import ignore_progress
from rfca_rig.recording.model import Column, RawStage, Stream
from rfca_rig.recording.store import write_recording
from tests.campaign.small import SMALL, edit, swap
from tests.recording.samples import recording, stage, stroke

EFFECT = {"id": "motor_speed_droop", "parameters": {"kp_Nm_s_per_rad": 8.1, "ki_Nm_per_rad": 61.0}}
CURVE = {
    "angles_deg": [3.0, 8.0, 14.0],
    "torques_Nm": [0.5812345678901234, 1.67, 3.37],
    "standard_deviations_Nm": [0.01, 0.01, 0.02],
}


def make_run():
    """A run with strokes, static stages and raw samples, whose values have all their digits."""
    nominal = dict(read_campaign(SMALL).nominal)
    nominal["leg"] = {**nominal["leg"], "k0_Nm_per_rad": 10.0 / 3.0, "start_angle_rad": 0.1 + 0.2}
    late = stroke(4)
    shaft = late.streams["shaft"]
    torque = np.full(len(shaft.t_s), 0.1)
    # A drive that had not told its torque yet, and records that overtook each other.
    torque[:3] = np.nan
    t_s = shaft.t_s - 0.05
    t_s[[10, 11]] = t_s[[11, 10]]
    columns = {**shaft.columns, "motor_torque_Nm": Column(torque, "N m")}
    streams = {**late.streams, "shaft": Stream(t_s + 0.05, columns)}
    known = recording(3)
    raw = (
        RawStage("stage 1 at 235 mm", 0.235, stroke(5).streams),
        RawStage(
            "flap 215 mm",
            0.215,
            {"shaft": Stream(np.zeros(0), {"host_s": Column(np.zeros(0), "s")})},
            "TRIP L-01",
        ),
    )
    # Strokes of the sample end before the motion starts.
    strokes = []
    for known_stroke in (*known.strokes, replace(late, streams=streams)):
        moved = {}
        for name, stream in known_stroke.streams.items():
            moved[name] = Stream(stream.t_s + 0.08, stream.columns)
        strokes.append(replace(known_stroke, streams=moved))
    return replace(
        known,
        nominal=nominal,
        known_to={"height_mm": 0.1 + 0.2, "k0_relative": 0.03},
        strokes=tuple(strokes),
        static=(replace(stage(1), held_s=2.5, strokes_before=7), stage(2), stage(3)),
        raw=raw,
        provenance={"operator": "Ada", "started_at": "2026-03-14", "seed": "3"},
    )


def round_trip(run, folder):
    """Export the run, import what was exported, and open it."""
    export_csv(run, folder / "csv", ignore_progress)
    import_campaign(folder / "csv", folder / "imported", as_is=True)
    return open_recordings([folder / "imported"])[0]


def assert_same_streams(ours, theirs):
    assert list(ours) == list(theirs)
    for name, stream in ours.items():
        np.testing.assert_array_equal(theirs[name].t_s, stream.t_s)
        assert list(theirs[name].columns) == list(stream.columns)
        for key, column in stream.columns.items():
            other = theirs[name].columns[key]
            assert other.unit == column.unit, key
            np.testing.assert_array_equal(other.values, column.values)
            # Counts stay whole numbers, of any size of theirs.
            if len(column.data):
                assert other.data.dtype.kind in ("i" if column.data.dtype.kind in "iu" else "f")


def assert_same_for_analyses(ours, theirs):
    for name in ("title", "nominal", "known_to"):
        assert getattr(theirs, name) == getattr(ours, name), name
    assert len(theirs.strokes) == len(ours.strokes)
    for one, other in zip(ours.strokes, theirs.strokes, strict=True):
        for name in ("height_m", "speed_rad_s", "repeat", "strokes_before"):
            assert getattr(other, name) == getattr(one, name), name
        assert_same_streams(one.streams, other.streams)
    assert len(theirs.static) == len(ours.static)
    for one, other in zip(ours.static, theirs.static, strict=True):
        for part in fields(one):
            assert repr(getattr(other, part.name)) == repr(getattr(one, part.name)), part.name
    assert len(theirs.raw) == len(ours.raw)
    for one, other in zip(ours.raw, theirs.raw, strict=True):
        about = (one.label, one.height_m, one.cut_short)
        assert (other.label, other.height_m, other.cut_short) == about
        assert_same_streams(one.streams, other.streams)


@pytest.fixture
def run(tmp_path):
    (tmp_path / "run").mkdir()
    write_recording(make_run(), tmp_path / "run" / "run.h5")
    return tmp_path / "run"


def test_a_run_comes_back_to_the_last_digit_and_is_an_import(run, tmp_path):
    (ours,) = open_recordings([run])
    theirs = round_trip(run, tmp_path)
    assert_same_for_analyses(ours, theirs)
    assert [stroke.strokes_before for stroke in theirs.strokes] == [0, 1, 2, 3]
    assert (ours.source, theirs.source) == ("SIM", "IMPORT")
    assert theirs.provenance["recorded_as"] == "SIM"
    assert theirs.provenance["operator"] == "Ada"
    # What only the run itself may say of itself does not come along.
    assert "seed" not in theirs.provenance


def test_a_second_round_trip_changes_nothing_and_keeps_what_it_was(run, tmp_path):
    first = round_trip(run, tmp_path)
    (tmp_path / "again").mkdir()
    second = round_trip(tmp_path / "imported", tmp_path / "again")
    assert_same_for_analyses(first, second)
    assert second.provenance["recorded_as"] == "SIM"
    files = sorted(path.relative_to(tmp_path / "csv") for path in (tmp_path / "csv").rglob("*"))
    for file in files:
        ours = tmp_path / "csv" / file
        if ours.is_file():
            theirs = tmp_path / "again" / "csv" / file
            assert theirs.read_bytes() == ours.read_bytes(), file


def test_a_campaign_comes_back_from_its_import(tmp_path):
    import_campaign(SMALL, tmp_path / "run")
    (ours,) = open_recordings([tmp_path / "run"])
    theirs = round_trip(tmp_path / "run", tmp_path)
    assert_same_for_analyses(ours, theirs)
    assert theirs.provenance["recorded_as"] == "IMPORT"


@pytest.mark.parametrize("changes", [{"effects": [EFFECT]}, {"torque_rotation": CURVE}])
def test_a_nominal_model_with_effects_or_a_curve_comes_back(run, tmp_path, changes):
    known = make_run()
    nominal = {**known.nominal, **{key: changes[key] for key in changes if key == "effects"}}
    if "torque_rotation" in changes:
        keys = ("hinge_torque_Nm", "k0_Nm_per_rad", "k2_per_rad2")
        leg = {key: value for key, value in nominal["leg"].items() if key not in keys}
        nominal["leg"] = {**leg, **dict.fromkeys(keys), **changes}
    write_recording(replace(known, nominal=nominal), run / "run.h5")
    theirs = round_trip(run, tmp_path)
    assert theirs.nominal == nominal


def test_photos_come_along(run, tmp_path):
    (run / "photos").mkdir()
    (run / "photos" / "001.png").write_bytes(b"a photo")
    theirs = round_trip(run, tmp_path)
    assert (tmp_path / "imported" / "photos" / "001.png").read_bytes() == b"a photo"
    # The other one was not there before either.
    assert theirs.static[2].photo == "photos/003.png"
    assert not (tmp_path / "imported" / "photos" / "003.png").exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "static.csv",
            "photos/001.png",
            "../x.png",
            r"static\.csv:2: column photo: should be a pa",
        ),
        ("static.csv", ",yes,", ",maybe,", r"static\.csv:2: column settled: 'maybe' should be yes"),
        ("campaign.toml", '"stages/001-shaft.csv"', '"../x.csv"', "must lie inside the campaign"),
        ("campaign.toml", '"stages/001-shaft.csv"', '"stages/x.csv"', r"x\.csv is not there"),
        ("campaign.toml", 'recorded_as = "SIM"', 'recorded_as = "TRUE"', "recorded_as: should be"),
        ("campaign.toml", "streams = {", "file = 'a.csv'\nstreams = {", "takes file, or else str"),
    ],
)
def test_a_fault_in_an_exported_folder_is_one_line(run, tmp_path, file, old, new, message):
    export_csv(run, tmp_path / "csv", ignore_progress)
    edit(tmp_path / "csv" / file, swap(old, new))
    with pytest.raises(BadInput, match=message) as refused:
        import_campaign(tmp_path / "csv", tmp_path / "imported", as_is=True)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "imported").exists()


def test_a_recording_without_a_nominal_model_is_exported_without_campaign_toml(run, tmp_path):
    write_recording(replace(make_run(), nominal={}), run / "run.h5")
    exported = export_csv(run, tmp_path / "csv", ignore_progress)
    assert not exported.is_campaign
    assert not (tmp_path / "csv" / "campaign.toml").exists()


def test_reports_of_both_have_the_same_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import_campaign(SMALL, tmp_path / "run")
    type_in("export", "csv", "run", "--out", "csv")
    type_in("import", "csv", "--out", "imported")
    for name in ("run", "imported"):
        type_in("report", name, "--out", f"report-{name}")
        type_in("static", "report", name, "--out", f"static-{name}")
    for file in ("report-{}/table2.json", "static-{}/values.csv", "static-{}/curve.csv"):
        ours = (tmp_path / file.format("run")).read_text("utf-8")
        theirs = (tmp_path / file.format("imported")).read_text("utf-8")
        assert theirs == ours, file
    assert json.loads((tmp_path / "report-run" / "table2.json").read_text("utf-8"))["rows"]


def type_in(*words):
    ran = CliRunner().invoke(app, list(words))
    assert ran.exit_code == 0, ran.output
