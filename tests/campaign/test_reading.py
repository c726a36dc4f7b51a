import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.opening import import_campaign
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import read_recording
from tests.campaign.small import SMALL, copy_to, edit, swap, with_column, without_column
from tests.recording.same import assert_same


def test_a_campaign_is_read_as_it_stands():
    found = read_campaign(SMALL)
    assert (found.title, found.source) == ("A small campaign", "IMPORT")
    assert [(s.height_m, s.speed_rad_s, s.repeat) for s in found.strokes] == [
        (0.215, 2.433, 1),
        (0.215, 2.433, 2),
        (0.235, 3.25, 1),
        (0.235, 3.25, 2),
    ]
    t_s, fz_N = found.strokes[0].channel("fz_N")
    assert (len(t_s), t_s[0], fz_N[0]) == (211, -0.1, 3.058)
    assert found.strokes[0].streams["table"].columns["tx_Nm"].unit == "N m"
    assert found.known_to["k0_relative"] == 0.03


def test_static_stages_are_read_as_they_stand():
    stages = read_campaign(SMALL).static
    assert len(stages) == 16
    sixth = stages[5]
    seventh = stages[6]
    assert (sixth.height_m, sixth.stage, sixth.direction, seventh.direction) == (
        0.215,
        6,
        "loading",
        "unloading",
    )
    assert sixth.hinge_deg == (-23.012, -22.926, -21.614, -19.197, -14.963, -9.085)
    assert (sixth.shaft_angle_rad, sixth.fy_N, sixth.fz_N, sixth.tx_Nm, sixth.settled) == (
        2.3561,
        -17.224,
        -41.27,
        5.6336,
        None,
    )


def test_believed_is_kept_in_the_files_own_units_and_makes_a_model():
    nominal = read_campaign(SMALL).nominal
    assert list(nominal) == ["leg", "ground", "sensor", "drive"]
    assert nominal["leg"]["link_lengths_mm"][0] == 54.0
    assert nominal_model(nominal).leg.link_lengths_m[0] == 0.054


def test_spreadsheet_habits_change_nothing(tmp_path: Path):
    """Byte-order mark, CRLF, quoted names and numbers, blanks, empty lines at the end."""
    campaign = copy_to(tmp_path)
    for file in campaign.rglob("*.csv"):
        text = (
            file.read_text()
            .replace("fz_N", '"fz_N"')
            .replace(",3.058", ', "3.058"')
            .replace("loading", "loading ")
            .replace("\n", "\r\n")
        )
        file.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\r\n\r\n")
    plain = read_campaign(SMALL)
    dressed = read_campaign(campaign)
    assert plain.provenance["sha256"] != dressed.provenance["sha256"]
    assert_same(_without_provenance(plain), _without_provenance(dressed))


def _without_provenance(recording):
    return type(recording)(**{**recording.__dict__, "provenance": {}})


@pytest.mark.parametrize(
    "gone", ["shaft_angle_rad", "shaft_speed_rad_s", "motor_torque_Nm", "fx_N", "fz_N", "tz_Nm"]
)
def test_any_channel_may_be_absent(tmp_path: Path, gone: str):
    campaign = copy_to(tmp_path)
    edit(campaign / "runs/dynamic-01.csv", without_column(gone))
    assert read_campaign(campaign).strokes[0].channel(gone) is None


def test_without_hinge_columns_their_angles_are_not_known(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(campaign / "runs/static.csv", without_column("hinge4_deg"))
    hinges = read_campaign(campaign).static[0].hinge_deg
    assert np.isnan(hinges).tolist() == [False, False, True, False, False, False]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("temperature_C", "degC"),
        ("commanded_speed_rad_s", "rad/s"),
        ("frame", ""),
        ("fz_raw", ""),
        ("rack_mm", "mm"),
        ("speed_m/s", ""),
        ("shaft_angle_deg", "deg"),
        ("T", ""),
        ("bus_V", "V"),
        ("fz_N filtered", ""),
    ],
)
def test_extra_columns_are_kept_with_the_unit_their_name_ends_in(
    tmp_path: Path, name: str, unit: str
):
    campaign = copy_to(tmp_path)
    edit(campaign / "runs/dynamic-01.csv", with_column(name, "21.5"))
    column = read_campaign(campaign).strokes[0].streams["table"].columns[name]
    assert column.unit == unit
    assert (column.values == 21.5).all()


def test_strokes_and_stages_are_counted_where_the_campaign_says_so(tmp_path: Path):
    campaign = copy_to(tmp_path)
    assert {
        each.strokes_before
        for each in (*read_campaign(campaign).strokes, *read_campaign(campaign).static)
    } == {None}
    edit(
        campaign / "campaign.toml",
        swap('file = "runs/dynamic-02.csv"', 'file = "runs/dynamic-02.csv"\nstrokes_before = 7'),
    )
    edit(
        campaign / "campaign.toml",
        swap(
            'file = "runs/static.csv"',
            'file = "runs/static.csv"\nstrokes_before = 30\nheld_s = 2.5',
        ),
    )
    found = read_campaign(campaign)
    assert [stroke.strokes_before for stroke in found.strokes] == [None, 7, None, None]
    assert {(stage.strokes_before, stage.held_s) for stage in found.static} == {(30, 2.5)}
    again = read_recording(import_campaign(campaign, tmp_path / "imported"))
    assert [stroke.strokes_before for stroke in again.strokes] == [None, 7, None, None]
    assert {(stage.strokes_before, stage.held_s) for stage in again.static} == {(30, 2.5)}


def test_two_strokes_that_count_alike_are_refused(tmp_path: Path):
    campaign = copy_to(tmp_path)
    for file in ("runs/dynamic-02.csv", "runs/dynamic-04.csv"):
        edit(
            campaign / "campaign.toml",
            swap(f'file = "{file}"', f'file = "{file}"\nstrokes_before = 7'),
        )
    with pytest.raises(
        BadInput,
        match=(
            r"campaign.toml:\d+: runs\[4\].strokes_before: 7 strokes were before runs\[2\] "
            r"already; count each"
        ),
    ):
        read_campaign(campaign)


def test_a_count_below_zero_is_refused(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(
        campaign / "campaign.toml",
        swap('file = "runs/static.csv"', 'file = "runs/static.csv"\nstrokes_before = -1'),
    )
    with pytest.raises(BadInput, match=r"campaign.toml:.*strokes_before"):
        read_campaign(campaign)


def test_extra_static_columns_are_kept_as_written(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(campaign / "runs/static.csv", with_column("remark", "slipped µ"))
    found = read_campaign(campaign)
    assert json.loads(found.provenance["static_extra_columns"]) == {
        "runs/static.csv": {"remark": ["slipped µ"] * 16}
    }


def test_known_to_may_be_left_out(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(
        campaign / "campaign.toml",
        lambda text: text[: text.index("[known_to]")] + text[text.index("[[runs]]") :],
    )
    assert read_campaign(campaign).known_to == {}


def test_provenance_holds_the_description_word_for_word(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(campaign / "campaign.toml", swap("# straight,", "# Straight,"))
    assert "# Straight, below the horizontal" in read_campaign(campaign).provenance["campaign.toml"]


def test_27_files_of_1400_rows_are_read_whole(tmp_path: Path):
    campaign = copy_to(tmp_path)
    header, first, *rest = (campaign / "runs/dynamic-01.csv").read_text().strip().split("\n")
    dense = [header, first] + [
        f"{-0.099 + 0.001 * i:.4f},{row.split(',', 1)[1]}" for i, row in enumerate(rest * 7)
    ]
    shutil.copy(campaign / "runs/static.csv", tmp_path)
    for file in campaign.rglob("*.csv"):
        file.unlink()
    runs = ""
    for k in range(1, 28):
        (campaign / f"runs/{k}.csv").write_text("\n".join(dense) + "\n")
        runs += (
            f'[[runs]]\nexperiment = "dynamic"\nfile = "runs/{k}.csv"\nheight_mm = '
            f"215\nspeed_rad_s = 3\nrepeat = {k}\n"
        )
    edit(campaign / "campaign.toml", lambda text: text[: text.index("[[runs]]")] + runs)
    found = read_campaign(campaign)
    assert sum(len(stroke.channel("fz_N")[0]) for stroke in found.strokes) == 27 * 1471


def test_who_measured_what_and_when_is_recorded(tmp_path):
    folder = copy_to(tmp_path)
    # A date of TOML and a text are the same.
    edit(
        folder / "campaign.toml",
        swap("[leg]", '[about]\ndate = 2026-03-14\noperator = "Ada"\nspecimen = "leg 4"\n\n[leg]'),
    )
    stated = read_campaign(folder).provenance
    assert (stated["started_at"], stated["operator"], stated["sample"]) == (
        "2026-03-14",
        "Ada",
        "leg 4",
    )
    assert "rig" not in stated
