"""[columns] of a campaign: files that call a quantity otherwise, or have it in another unit."""

import csv

import numpy as np
import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput
from tests.campaign.small import SMALL, copy_to, edit, swap

# As a data logger of another make writes the same strokes: its names, units and signs.
FACTORS = {
    "t_s": ("Zeit", 1e3),
    "shaft_angle_rad": ("Winkel", 180.0 / np.pi),
    "fz_N": ("Fz (up)", -1e-3),
}
COLUMNS = """
[columns]
t_s = { name = "Zeit", unit = "ms" }
shaft_angle_rad = { name = "Winkel", unit = "deg" }
fz_N = { name = "Fz (up)", unit = "kN", sign = -1 }

[[runs]]"""


def write_otherwise(path):
    """The stroke with other names, units and signs, semicolons and decimal commas."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *samples = list(csv.reader(file))
    names = [FACTORS.get(name, (name, 1.0))[0] for name in header]
    factors = [FACTORS.get(name, (name, 1.0))[1] for name in header]
    lines = [";".join(names)]
    for sample in samples:
        numbers = [factor * float(cell) for cell, factor in zip(sample, factors, strict=True)]
        lines.append(";".join(f"{number:.12g}".replace(".", ",") for number in numbers))
    path.write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture
def campaign(tmp_path):
    folder = copy_to(tmp_path)
    for number in range(1, 5):
        write_otherwise(folder / "runs" / f"dynamic-0{number}.csv")
    edit(folder / "campaign.toml", swap("[[runs]]", COLUMNS))
    return folder


def test_a_campaign_of_another_logger_is_read_without_rewriting_a_file(campaign):
    ours = read_campaign(SMALL)
    theirs = read_campaign(campaign)
    assert theirs.static == ours.static
    for our_stroke, their_stroke in zip(ours.strokes, theirs.strokes, strict=True):
        our_table = our_stroke.streams["table"]
        their_table = their_stroke.streams["table"]
        assert their_table.t_s == pytest.approx(our_table.t_s, abs=1e-9)
        assert list(their_table.columns) == list(our_table.columns)
        for name, column in our_table.columns.items():
            assert their_table.columns[name].unit == column.unit
            assert their_table.columns[name].values == pytest.approx(column.values, abs=1e-8)


def test_an_offset_is_added_in_the_unit_of_the_quantity(campaign):
    edit(campaign / "campaign.toml", swap('unit = "deg"', 'unit = "deg", offset = 0.25'))
    moved = read_campaign(campaign).strokes[0].streams["table"].columns["shaft_angle_rad"]
    there = read_campaign(SMALL).strokes[0].streams["table"].columns["shaft_angle_rad"]
    assert moved.values == pytest.approx(there.values + 0.25, abs=1e-8)


def test_columns_of_static_stages_are_mapped_too(tmp_path):
    folder = copy_to(tmp_path)
    edit(folder / "runs" / "static.csv", lambda text: text.replace("height_mm", "h", 1))
    line = '[columns]\nheight_mm = { name = "h", unit = "cm" }\n\n[[runs]]'
    edit(folder / "campaign.toml", swap("[[runs]]", line))
    ours = read_campaign(SMALL).static
    theirs = read_campaign(folder).static
    assert [stage.height_m for stage in theirs] == pytest.approx(
        [10.0 * stage.height_m for stage in ours]
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("fz_N = {", "fz_n = {", "columns.fz_n: did you mean fz_N?"),
        ('unit = "kN"', 'unit = "deg"', "columns.fz_N.unit: 'deg' cannot be converted to N"),
        ('unit = "kN"', 'unit = "kiloX"', "columns.fz_N.unit: 'kiloX' cannot be converted to N"),
        (
            'name = "Winkel"',
            'name = "Zeit"',
            "columns.shaft_angle_rad: column Zeit is already that of t_s",
        ),
        ("sign = -1", "sign = 2", "columns.fz_N.sign"),
        (
            'name = "Fz (up)"',
            'name = "Fz"',
            "dynamic-01.csv:1: column Fz, which [columns.fz_N] names, is missing",
        ),
    ],
)
def test_a_fault_in_the_map_is_one_line(campaign, old, new, said):
    edit(campaign / "campaign.toml", swap(old, new))
    with pytest.raises(BadInput) as refused:
        read_campaign(campaign)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def add_units(path, force):
    """A row of units, in which the force has this one."""
    header, rest = path.read_text(encoding="utf-8").split("\n", 1)
    units = ["s", "rad", "rad/s", "N m", "N", "N", force, "N m", "N m", "N m"]
    assert len(units) == len(header.split(","))
    path.write_text(f"{header}\n{','.join(units)}\n{rest}", encoding="utf-8")


def test_a_row_of_units_that_contradicts_a_name_is_refused(tmp_path):
    folder = copy_to(tmp_path)
    add_units(folder / "runs" / "dynamic-01.csv", "N")
    assert read_campaign(folder).strokes
    add_units(folder / "runs" / "dynamic-02.csv", "kN")
    with pytest.raises(
        BadInput,
        match=(
            r'column fz_N: the file states the unit kN, and fz_N is in N; write unit = "kN" in '
            r"\[columns\.fz_N\]"
        ),
    ):
        read_campaign(folder)
