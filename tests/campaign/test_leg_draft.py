"""What `init --data` finds in a folder of other people's recordings beside the columns of strokes:
starts, ends, conditions, static stages, files of several forms.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.campaign.leg_draft import find_condition, write_leg_draft
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.cli.paths import find_shipped
from rfca_rig.description.model_file import nominal_model
from rfca_rig.description.sections import RigSections
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_data
from tests.campaign.foreign import Format, Written, write_stroke
from tests.campaign.small import SMALL
from tests.campaign.test_foreign_strokes import ask

# At 500 Hz the start of a shaft that speeds up within 50 ms shows to a sample or two.
MOST_START_ERROR_S = 0.003
CONDITIONS = ((215.0, 2.4), (215.0, 3.2), (240.0, 2.4), (240.0, 4.5))
REST_S = 0.3
LOGGER = Format(
    {
        "t_s": Written("Zeit [ms]", "ms"),
        "shaft_angle_rad": Written("Winkel [deg]", "deg", -1),
        "fy_N": Written("Kraft Y [kN]", "kN"),
        "fz_N": Written("Kraft Z [kN]", "kN", -1),
        "tx_Nm": Written("Mx [Nm]", "Nm"),
    },
    separator=";",
    decimal=",",
    shift_s=0.4,
    extra={"Status": "OK"},
)


@pytest.fixture(scope="module")
def usual():
    return read_data(find_shipped("calibration") / "twin.toml")


@pytest.fixture(scope="module")
def strokes(usual):
    """Simulated strokes at 500 Hz, with noise of an encoder and a sensor, and a longer rest."""
    sections = {name: usual[name] for name in RigSections.model_fields if name in usual}
    model = nominal_model(sections)
    rng = np.random.default_rng(7)
    truths = []
    for height_mm, speed_rad_s in CONDITIONS:
        stroke = predict_stroke(model, height_mm / 1e3, speed_rad_s, 165.0).stroke
        t_s = np.arange(round(-500 * REST_S), int(500 * stroke.t_s[-1])) / 500.0
        truth = {"t_s": t_s}
        columns = {
            "shaft_angle_rad": (stroke.shaft_angle_rad, 5e-4),
            "fy_N": (stroke.fy_N, 0.1),
            "fz_N": (stroke.fz_N, 0.15),
            "tx_Nm": (stroke.tx_Nm, 0.006),
        }
        for name, (values, noise) in columns.items():
            at_times = np.interp(t_s, stroke.t_s, values)
            truth[name] = at_times + noise * rng.standard_normal(len(t_s))
        truths.append(truth)
    return truths


def write_all(folder, strokes, name="stroke {number}", how=LOGGER):
    folder.mkdir(exist_ok=True)
    for number, truth in enumerate(strokes):
        height_mm, speed_rad_s = CONDITIONS[number % len(CONDITIONS)]
        stem = name.format(number=number, height=height_mm, speed=speed_rad_s)
        write_stroke(folder / stem, truth, how, number)


def draft(folder, usual):
    return write_leg_draft(folder, usual).path


def test_a_stroke_begins_when_the_recorded_angle_begins_to_turn(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", strokes, "{height}mm {speed}rad_s")
    (tmp_path / "theirs").rename(tmp_path / "there")
    theirs = read_campaign(draft(tmp_path / "there", usual).parent)
    assert len(theirs.strokes) == len(CONDITIONS)
    by_condition = {(s.height_m * 1e3, s.speed_rad_s): s for s in theirs.strokes}
    for condition, truth in zip(CONDITIONS, strokes, strict=True):
        stream = by_condition[condition].streams["table"]
        shift_s = stream.t_s - truth["t_s"]
        assert np.ptp(shift_s) < 1e-9
        assert abs(shift_s[0]) < MOST_START_ERROR_S
        angle = stream.columns["shaft_angle_rad"].values
        np.testing.assert_allclose(angle, truth["shaft_angle_rad"], atol=1e-9)
    assert theirs.nominal["leg"]["start_angle_rad"] == pytest.approx(0.2461, abs=1e-3)
    assert theirs.nominal["drive"]["ramp_s"] == pytest.approx(0.05, abs=0.01)


def test_a_stroke_begins_when_the_recorded_speed_begins_to_rise(tmp_path, strokes, usual):
    names = dict(LOGGER.columns)
    del names["shaft_angle_rad"]
    names["shaft_speed_rad_s"] = Written("Drehzahl [rpm]", "rpm")
    truths = []
    for truth in strokes:
        speed = np.gradient(truth["shaft_angle_rad"], truth["t_s"])
        truths.append({**truth, "shaft_speed_rad_s": speed})
    how = replace(LOGGER, columns=names)
    write_all(tmp_path / "theirs", truths, "{height}mm {speed}rad_s", how)
    theirs = read_campaign(draft(tmp_path / "theirs", usual).parent)
    for stroke in theirs.strokes:
        assert abs(stroke.streams["table"].t_s[0] + REST_S) < MOST_START_ERROR_S


def test_speeds_come_from_the_angle_where_no_name_states_them(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", [*strokes, *strokes], "h{height:.0f} no{number}")
    theirs = read_campaign(draft(tmp_path / "theirs", usual).parent)
    found = sorted((round(s.height_m * 1e3), s.speed_rad_s, s.repeat) for s in theirs.strokes)
    expected = sorted((*condition, repeat) for condition in CONDITIONS for repeat in (1, 2))
    for (height, speed, _), (true_height, true_speed, _) in zip(found, expected, strict=True):
        assert height == true_height
        assert speed == pytest.approx(true_speed, rel=0.01)
    # The repeats of a condition have one speed.
    assert len({(height, speed) for height, speed, _ in found}) == len(CONDITIONS)


def test_heights_that_no_name_states_are_asked_for(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", strokes)
    path = draft(tmp_path / "theirs", usual)
    answers = {f"runs[{n}].height_mm": f"height_mm = {h}" for n, (h, _) in enumerate(CONDITIONS, 1)}
    theirs, asked = ask(path, answers)
    assert asked == set(answers)
    assert [s.height_m * 1e3 for s in theirs.strokes] == [h for h, _ in CONDITIONS]


def test_a_shaft_that_comes_back_ends_the_stroke(tmp_path, strokes, usual):
    returning = []
    for truth in strokes:
        last = {name: values[-1] for name, values in truth.items()}
        hold = 100
        back = 400
        longer = {}
        for name, values in truth.items():
            if name == "t_s":
                more = last[name] + np.arange(1, hold + back + 1) / 500.0
            elif name == "shaft_angle_rad":
                way = np.linspace(last[name], values[0], back)
                more = np.concatenate([np.full(hold, last[name]), way])
            else:
                more = np.full(hold + back, last[name])
            longer[name] = np.concatenate([values, more])
        returning.append(longer)
    write_all(tmp_path / "theirs", returning, "{height}mm {speed}rad_s")
    theirs = read_campaign(draft(tmp_path / "theirs", usual).parent)
    by_condition = {(s.height_m * 1e3, s.speed_rad_s): s for s in theirs.strokes}
    for condition, truth in zip(CONDITIONS, strokes, strict=True):
        ends_s = by_condition[condition].streams["table"].t_s[-1]
        assert 0.9 * truth["t_s"][-1] < ends_s < truth["t_s"][-1] + 0.02


def test_an_encoder_that_counts_from_the_start_is_asked_for_its_offset(tmp_path, strokes, usual):
    counted = []
    for truth in strokes:
        angle = truth["shaft_angle_rad"]
        counted.append({**truth, "shaft_angle_rad": angle - np.mean(angle[:50])})
    write_all(tmp_path / "theirs", counted, "{height}mm {speed}rad_s")
    path = draft(tmp_path / "theirs", usual)
    theirs, asked = ask(path, {"columns.shaft_angle_rad.offset": "offset = 0.246"})
    assert asked == {"columns.shaft_angle_rad.offset"}
    first = theirs.strokes[0].streams["table"].columns["shaft_angle_rad"].values[:50]
    assert np.mean(first) == pytest.approx(0.246, abs=1e-6)


def test_strokes_in_the_air_are_asked_for_their_signs(tmp_path, strokes, usual):
    sections = {name: usual[name] for name in RigSections.model_fields if name in usual}
    stroke = predict_stroke(nominal_model(sections), 0.32, 3.0, 165.0).stroke
    t_s = strokes[1]["t_s"]
    swing = {"t_s": t_s}
    for name in ("shaft_angle_rad", "fy_N", "fz_N", "tx_Nm"):
        swing[name] = np.interp(t_s, stroke.t_s, getattr(stroke, name))
    in_the_air = [swing]
    write_all(tmp_path / "theirs", in_the_air, "{height}mm {speed}rad_s")
    answers = {"columns.fz_N.sign": "sign = -1", "columns.fy_N.sign": "sign = 1"}
    theirs, asked = ask(draft(tmp_path / "theirs", usual), answers)
    assert asked == set(answers)
    read = theirs.strokes[0].streams["table"].columns["fz_N"].values
    np.testing.assert_allclose(read, in_the_air[0]["fz_N"], atol=1e-9)


def test_files_of_two_forms_have_columns_of_their_own(tmp_path, strokes, usual):
    other = Format(
        {
            "t_s": Written("time_s", "s"),
            "shaft_angle_rad": Written("theta_rad", "rad"),
            "fz_N": Written("force z (N)", "N"),
        },
        kind="h5",
    )
    folder = tmp_path / "theirs"
    write_all(folder, strokes[:3], "{height}mm {speed}rad_s")
    write_stroke(folder / "240mm 4.5rad_s", strokes[3], other, 0)
    theirs = read_campaign(draft(folder, usual).parent)
    assert len(theirs.strokes) == 4
    (stroke,) = [stroke for stroke in theirs.strokes if stroke.speed_rad_s == 4.5]
    columns = stroke.streams["table"].columns
    np.testing.assert_allclose(columns["fz_N"].values, strokes[3]["fz_N"], atol=1e-12)
    assert "fy_N" not in columns


def test_a_stroke_in_a_bag_is_read_by_the_same_columns(tmp_path, strokes, usual):
    bags = pytest.importorskip("tests.campaign.bags")
    folder = tmp_path / "theirs"
    folder.mkdir()
    truth = strokes[0]
    shifted_s = truth["t_s"] - truth["t_s"][0]
    wrenches = []
    angles = []
    for t_s, fy, fz, angle in zip(
        shifted_s, truth["fy_N"], truth["fz_N"], truth["shaft_angle_rad"], strict=True
    ):
        wrenches.append((t_s, {"force": {"y": fy, "z": fz}}))
        angles.append((t_s, {"angle": angle}))
    bags.write_mcap(folder / "215mm 2.4rad_s.mcap", {"/wrench": wrenches, "/shaft": angles})
    path = draft(folder, usual)
    answers = {"columns.fy_N.unit": 'unit = "N"', "columns.fz_N.unit": 'unit = "N"'}
    theirs, asked = ask(path, answers)
    assert asked == set(answers)
    stream = theirs.strokes[0].streams["table"]
    assert abs(stream.t_s[0] - truth["t_s"][0]) < MOST_START_ERROR_S
    for name in ("fy_N", "fz_N", "shaft_angle_rad"):
        np.testing.assert_allclose(stream.columns[name].values, truth[name], atol=1e-9)


STATIC_NAMES = {
    "height_mm": ("Rack height [cm]", 0.1),
    "stage": ("Step", 1.0),
    "direction": ("Direction", None),
    "shaft_angle_rad": ("Shaft angle [deg]", 180.0 / np.pi),
    **{f"hinge{i}_deg": (f"Hinge {i} [rad]", -np.pi / 180.0) for i in range(2, 8)},
    "fy_N": ("Fy [kN]", 1e-3),
    "fz_N": ("Fz [kN]", -1e-3),
    "tx_Nm": ("Mx [Nmm]", 1e3),
}


def write_static(path: Path, names=STATIC_NAMES):
    with (SMALL / "runs" / "static.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    lines = [";".join(names[name][0] for name in header if name in names)]
    for row in rows:
        cells = []
        for name, cell in zip(header, row, strict=True):
            if name not in names:
                continue
            factor = names[name][1]
            cells.append(cell if factor is None else repr(factor * float(cell)))
        lines.append(";".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_static_stages_are_found_with_their_own_columns(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", strokes, "{height}mm {speed}rad_s")
    write_static(tmp_path / "theirs" / "bending.csv")
    theirs = read_campaign(draft(tmp_path / "theirs", usual).parent)
    ours = read_campaign(SMALL)
    assert len(theirs.strokes) == 4
    assert len(theirs.static) == len(ours.static)
    for their_stage, our_stage in zip(theirs.static, ours.static, strict=True):
        assert (their_stage.stage, their_stage.direction) == (our_stage.stage, our_stage.direction)
        for name in ("height_m", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm"):
            assert getattr(their_stage, name) == pytest.approx(getattr(our_stage, name), rel=1e-9)
        assert their_stage.hinge_deg == pytest.approx(our_stage.hinge_deg, rel=1e-9)


def test_what_a_table_of_static_stages_lacks_is_asked_for(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", strokes, "{height}mm {speed}rad_s")
    names = {name: how for name, how in STATIC_NAMES.items() if name != "height_mm"}
    write_static(tmp_path / "theirs" / "bending.csv", names)
    path = draft(tmp_path / "theirs", usual)
    with pytest.raises(BadInput, match=r"runs\[5\]\.columns\.height_mm\.name: is still a question"):
        read_campaign(path.parent)


@pytest.mark.parametrize(
    ("file", "height_mm", "speed_rad_s"),
    [
        ("h215mm_2.433rad_s_rep1.csv", 215.0, 2.433),
        ("215 mm/2,4 rad per s 03.csv", 215.0, 2.4),
        ("H=21.5cm v=3.2.csv", 215.0, 3.2),
        ("leg-b/h0215_w2p4_7.h5", 215.0, 2.4),
        ("height 0.215m 140deg_s.csv", 215.0, 140.0 * np.pi / 180.0),
        ("215mm_23rpm.csv", 215.0, 23.0 * np.pi / 30.0),
        # Two numbers may be the height, or none is.
        ("215mm or 235mm 2.4rad_s.csv", None, 2.4),
        ("stroke 7.csv", None, None),
        ("2026-05-01 14-30.csv", None, None),
    ],
)
def test_conditions_come_from_names(file, height_mm, speed_rad_s):
    height, speed = find_condition(file, None)
    assert (height and height[0]) == pytest.approx(height_mm)
    assert (speed and speed[0]) == pytest.approx(speed_rad_s)


def test_what_is_no_stroke_is_left_out_and_named(tmp_path, strokes, usual):
    write_all(tmp_path / "theirs", strokes, "{height}mm {speed}rad_s")
    (tmp_path / "theirs" / "notes.csv").write_text("who;what\n1;2\n3;4\n", encoding="utf-8")
    path = draft(tmp_path / "theirs", usual)
    assert len(read_campaign(path.parent).strokes) == 4
    assert "# Left out: notes.csv: no column is a time by its name" in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "holds no recording"),
        ({"campaign.toml": "mine"}, "campaign.toml: is there already; remove it, or edit it"),
        ({"run.h5": ""}, "is a run, which every command reads as it stands"),
        ({"a.csv": "who;what\n1;2\n3;4\n"}, "holds no stroke: a.csv: no column is a time"),
    ],
)
def test_a_folder_without_strokes_is_one_line(tmp_path, usual, files, message):
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(BadInput, match=message):
        write_leg_draft(tmp_path, usual)
    assert sorted(tmp_path.iterdir()) == before
