"""Every fault in a campaign is one line that names file, line and column, and leaves nothing
behind.
"""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from rfca_rig.campaign.opening import import_campaign
from rfca_rig.errors import BadInput
from tests.campaign.small import cell, copy_to, edit, line, swap, with_column, without_column

DYNAMIC = "runs/dynamic-02.csv"
STATIC = "runs/static.csv"
TOML = "campaign.toml"
HEADER = "t_s,shaft_angle_rad,shaft_speed_rad_s,motor_torque_Nm,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm"


def refusal(campaign: Path, out: Path) -> str:
    """What the import says, its path shortened to that inside the campaign."""
    with pytest.raises(BadInput) as caught:
        import_campaign(campaign, out / "deep" / "imported")
    assert caught.value.exit_code == 2
    said = str(caught.value)
    assert "\n" not in said
    assert [found.name for found in out.iterdir()] == ["campaign"]
    assert said.startswith(f"{campaign}/")
    return said.removeprefix(f"{campaign}/").replace(f"{campaign}/", "")


Change = Callable[[str], str]

CELLS: dict[str, tuple[Change, str]] = {
    "nan": (
        cell(8, 7, "NaN"),
        f"{DYNAMIC}:8: column fz_N: NaN is not a value; every cell needs a finite number",
    ),
    "infinite": (cell(9, 6, "-inf"), f"{DYNAMIC}:9: column fy_N: -inf is not a value"),
    "spreadsheet error": (
        cell(9, 6, "#DIV/0!"),
        f"{DYNAMIC}:9: column fy_N: #DIV/0! is not a value",
    ),
    "overflowing": (cell(9, 6, "1e999"), f"{DYNAMIC}:9: column fy_N: 1e999 is too large"),
    "empty": (cell(3, 10, ""), f"{DYNAMIC}:3: column tz_Nm: the cell is empty"),
    "a word": (
        cell(212, 2, "broken"),
        f"{DYNAMIC}:212: column shaft_angle_rad: 'broken' is not a number",
    ),
    "underscored digits": (
        cell(5, 2, "1_0"),
        f"{DYNAMIC}:5: column shaft_angle_rad: '1_0' is not a number",
    ),
    "decimal comma in quotes": (
        cell(4, 7, '"3,05"'),
        f"{DYNAMIC}:4: column fz_N: 3,05 has a decimal comma",
    ),
    "one cell too many": (
        swap("\n", ",extra\n"),
        f"{DYNAMIC}:2: 10 cells in the line for 11 columns",
    ),
    "a row cut short": (
        line(212, "1.3,2"),
        f"{DYNAMIC}:212: 2 cells in the line for 10 columns in the header",
    ),
    "an empty line": (line(50, ""), f"{DYNAMIC}:50: the line is empty; remove it"),
    "time backwards": (
        cell(30, 1, "-0.05"),
        f"{DYNAMIC}:30: column t_s: time runs backwards, from 0.089 s to -0.05 s",
    ),
    "time repeated": (
        cell(30, 1, "0.0890"),
        f"{DYNAMIC}:30: column t_s: time stands still at 0.089 s",
    ),
    "no rest before the start": (
        line(2, None),
        f"{DYNAMIC}:2: column t_s: begins at -0.093 s; needs 0.1 s or more before the motion",
    ),
    "no motion": (
        lambda text: "\n".join(text.split("\n")[:10]),
        f"{DYNAMIC}:10: column t_s: ends at -0.044 s, before the motion",
    ),
}

DECIMALS = "20 cells in the line for 10 columns in the header; do its numbers have a decimal comma?"
HEADERS: dict[str, tuple[Change, str]] = {
    "no time": (
        without_column("t_s"),
        f"{DYNAMIC}:1: column t_s is missing; the file has shaft_angle_rad, ",
    ),
    "time in ms": (
        swap("t_s", "t_ms"),
        f"{DYNAMIC}:1: column t_ms: this quantity is known in s, as t_s; convert it",
    ),
    "force in kN": (
        swap("fz_N", "fz_kN"),
        f"{DYNAMIC}:1: column fz_kN: this quantity is known in N, as fz_N; convert it",
    ),
    "angle in degrees": (
        swap("shaft_angle_rad", "shaft_angle_deg"),
        "column shaft_angle_deg: this quantity is known in rad, as",
    ),
    "speed in rpm": (
        swap("shaft_speed_rad_s", "Shaft speed [rpm]"),
        "column Shaft speed [rpm]: this quantity is known in rad/s",
    ),
    "no unit": (
        swap("fz_N", "Fz"),
        f"{DYNAMIC}:1: column Fz: its name says no unit; write fz_N if that is its unit",
    ),
    "another spelling": (swap("fz_N", "Fz (N)"), f"{DYNAMIC}:1: column Fz (N): write it fz_N"),
    "a name twice": (
        swap("fy_N", "fz_N"),
        f"{DYNAMIC}:1: column fz_N is there twice, as column 6 and as column 7",
    ),
    "a nameless column": (
        with_column("", "1"),
        f"{DYNAMIC}:1: column 11 has no readable name ('')",
    ),
    "no header": (
        line(1, None),
        f"{DYNAMIC}:1: the first line holds numbers; it must name the columns",
    ),
    "only time": (
        lambda text: "".join(row.split(",")[0] + "\n" for row in text.split("\n")),
        f"{DYNAMIC}:1: only t_s, and nothing",
    ),
    "decimal commas": (lambda text: text.replace(".", ","), DECIMALS),
    "no data": (lambda _: HEADER + "\n", f"{DYNAMIC}:1: holds column names and no data"),
    "empty file": (lambda _: "", f"{DYNAMIC}: is empty"),
    "blank file": (lambda _: "\n \n", f"{DYNAMIC}: is empty"),
}

STATICS: dict[str, tuple[Change, str]] = {
    "a direction that is none": (
        cell(3, 3, "up"),
        f"{STATIC}:3: column direction: 'up' should be loading or unloading",
    ),
    "missing column": (
        without_column("tx_Nm"),
        f"{STATIC}:1: column tx_Nm is missing; the file has height_mm, ",
    ),
    "hinge in radians": (
        swap("hinge3_deg", "hinge3_rad"),
        f"{STATIC}:1: column hinge3_rad: this quantity is known in deg, as hinge3_deg",
    ),
    "height in metres": (
        swap("height_mm", "height_m"),
        f"{STATIC}:1: column height_m: this quantity is known in mm, as height_mm",
    ),
    "empty hinge": (cell(5, 7, ""), f"{STATIC}:5: column hinge4_deg: the cell is empty"),
    "nan": (cell(17, 12, "nan"), f"{STATIC}:17: column fz_N: nan is not a value"),
    "half a stage": (cell(4, 2, "2.5"), f"{STATIC}:4: column stage: 2.5 should be a whole number"),
    "height below zero": (
        cell(4, 1, "-215"),
        f"{STATIC}:4: column height_mm: -215 should be greater than 0",
    ),
    "a row cut short": (
        line(6, "215,5,loading"),
        f"{STATIC}:6: 3 cells in the line for 13 columns",
    ),
}

RUNS = "runs/dynamic-04.csv"
TOMLS: dict[str, tuple[Change, str]] = {
    "another format": (
        swap("rfca-campaign/1", "rfca-campaign/2"),
        f"{TOML}:1: format: should be 'rfca-campaign/1', not 'rfca-",
    ),
    "misspelt key": (
        swap("friction_coefficient", "friction_coeficient"),
        "18: ground.friction_coeficient: unknown key; did you mean ",
    ),
    "unknown section": (
        swap("[ground]", "[floor]\nx = 1\n[ground]"),
        f"{TOML}:14: floor: unknown key; known are format, title, about",
    ),
    "no [leg]": (
        lambda text: text[: text.index("[leg]")] + text[text.index("[ground]") :],
        f"{TOML}: leg: missing",
    ),
    "missing height": (swap("height_mm = 215.0\n", ""), f"{TOML}:41: runs[1].height_mm: missing"),
    "height as text": (
        swap("height_mm = 235.0", 'height_mm = "235"'),
        f"{TOML}:58: runs[3].height_mm: should be a number",
    ),
    "speed backwards": (
        swap("speed_rad_s = 3.25", "speed_rad_s = -3.25"),
        f"{TOML}:59: runs[3].speed_rad_s: should be greater than 0",
    ),
    "another experiment": (
        swap('"static"', '"quasi-static"'),
        "69: runs[5]: 'experiment' should be one of 'dynamic', 'static', 'raw', not 'q",
    ),
    "not TOML": (swap("ramp_s = 0.05", "ramp_s = 0,05"), f"{TOML}:29: not TOML at column 11: "),
    "unclosed text": (
        swap('title = "A small campaign"', 'title = "A small campaign'),
        f"{TOML}:2: not TOML at column ",
    ),
    "no runs": (lambda text: text[: text.index("[[runs]]")], f"{TOML}: runs: missing"),
    "a missing file": (
        swap(RUNS, "runs/dynamic-4.csv"),
        f"{TOML}:64: runs[4].file: runs/dynamic-4.csv is not there; did you mean {RUNS}?",
    ),
    "a file named twice": (
        swap(RUNS, DYNAMIC),
        f"{TOML}:64: runs[4].file: {DYNAMIC} is already the file of runs[2]",
    ),
    "a file outside": (
        swap(RUNS, "../secret.csv"),
        f"{TOML}:64: runs[4].file: must lie inside the campaign's folder",
    ),
    "a Windows path": (
        swap(f'"{RUNS}"', r"'runs\dynamic-04.csv'"),
        f"{TOML}:64: runs[4].file: write / between folder and file",
    ),
    "a repeat twice": (
        swap(
            'repeat = 2\n\n[[runs]]\nexperiment = "static"',
            'repeat = 1\n\n[[runs]]\nexperiment = "static"',
        ),
        (
            f"{TOML}:67: runs[4].repeat: 235 mm, 3.25 rad/s, repeat 1 is already runs[3] "
            "(runs/dynamic-03.csv)"
        ),
    ),
    "a CSV that no run names": (
        lambda text: text[: text.index('[[runs]]\nexperiment = "static"')],
        f"{STATIC}: no run in campaign.toml names it; add a [[runs]] entry or take it away",
    ),
}

ALL = [
    pytest.param(file, change, said, id=f"{file}: {name}")
    for file, faults in ((DYNAMIC, CELLS), (DYNAMIC, HEADERS), (STATIC, STATICS), (TOML, TOMLS))
    for name, (change, said) in faults.items()
]


@pytest.mark.parametrize(("file", "change", "said"), ALL)
def test_a_fault_is_one_line_and_nothing_is_left_behind(
    tmp_path: Path, file: str, change: Change, said: str
):
    campaign = copy_to(tmp_path)
    edit(campaign / file, change)
    assert said in refusal(campaign, tmp_path)


@pytest.mark.parametrize("file", [DYNAMIC, STATIC, TOML])
def test_text_in_another_encoding_names_file_and_line(tmp_path: Path, file: str):
    campaign = copy_to(tmp_path)
    lines = (campaign / file).read_bytes().split(b"\n")
    (campaign / file).write_bytes(b"\n".join([lines[0], b"# \xb5m", *lines[1:]]))
    assert (
        refusal(campaign, tmp_path)
        == f"{file}:2: byte 0xb5 is not UTF-8 text; save the file as UTF-8"
    )


@pytest.mark.parametrize("file", [DYNAMIC, STATIC])
def test_a_file_that_is_gone_is_named_with_the_line_that_asks_for_it(tmp_path: Path, file: str):
    campaign = copy_to(tmp_path)
    (campaign / file).unlink()
    assert re.match(
        rf"campaign\.toml:\d+: runs\[\d\]\.file: {file} is not there$", refusal(campaign, tmp_path)
    )


def test_a_folder_that_is_no_campaign_says_what_one_is(tmp_path: Path):
    campaign = copy_to(tmp_path)
    (campaign / TOML).unlink()
    assert refusal(campaign, tmp_path).startswith(
        "campaign.toml: is not there; a campaign is a folder with campaign.toml and CSV files"
    )


def test_several_faults_in_campaign_toml_are_counted(tmp_path: Path):
    campaign = copy_to(tmp_path)
    edit(campaign / TOML, swap("k0_relative = 0.03", "k0_relativ = 0.03"))
    edit(campaign / TOML, swap("ramp_s = 0.05", "ramp_s = 0"))
    edit(campaign / TOML, swap("repeat = 1", "repeat = 0"))
    assert refusal(campaign, tmp_path) == (
        "campaign.toml:36: known_to.k0_relativ: unknown key; did you mean k0_relative? (and 2 more)"
    )


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="this system has no such file")
def test_a_file_whose_reading_the_system_refuses_is_named(tmp_path: Path) -> None:
    campaign = copy_to(tmp_path / "campaign")
    (campaign / DYNAMIC).unlink()
    (campaign / DYNAMIC).symlink_to("/proc/self/mem")
    with pytest.raises(BadInput) as refused:
        import_campaign(campaign, tmp_path / "out", allow_outside=True)
    assert str(refused.value) == f"{campaign / DYNAMIC}: cannot be read: Input/output error"
