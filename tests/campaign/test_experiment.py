"""experiment.toml and its recordings: units, signs and every fault in one line."""

import numpy as np
import pytest

from rfca_rig.campaign.experiment import RecordedSignal, read_experiment
from rfca_rig.campaign.opening import experiment_among
from rfca_rig.errors import BadInput

HEAD = """format = "rfca-experiment/1"
title = "cart"
model = "model.xml"
time = { column = "t", unit = "ms" }
signals = [
  { joint = "cart", quantity = "position", column = "x", unit = "mm", sign = -1, noise_std = 0.5 },
  { joint = "pole", quantity = "position", column = "angle", unit = "count", counts_per_turn = 4000 },
  { joint = "pole", quantity = "speed", column = "rate", unit = "deg/s" },
]
commands = [{ actuator = "push", column = "current", unit = "mA" }]
recordings = [{ file = "a.csv", condition = "slow" }, { file = "b.csv", condition = "free", driven = false, from_s = 0.005 }]
"""
ROWS = "".join(f"{5 + k},{k},{2 * k},note,{90 * k},{100 + k}\n" for k in range(20))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "experiment.toml").write_text(HEAD, encoding="utf-8")
    (tmp_path / "a.csv").write_text("t,x,angle,remark,rate,current\n" + ROWS, encoding="utf-8")
    (tmp_path / "b.csv").write_text("t,x,angle,remark,rate,current\n" + ROWS, encoding="utf-8")
    return tmp_path


def test_stated_units_and_signs_become_the_model_s(folder):
    first, second = read_experiment(folder).runs
    assert first.t_s[:2] == pytest.approx([0.005, 0.006])
    assert first.signals[3] == pytest.approx([-0.003, 2.0 * np.pi * 6 / 4000, np.radians(270.0)])
    assert first.commands[3] == pytest.approx([0.103])
    assert not second.commands.any()
    assert not second.driven
    assert first.driven


def test_a_held_command_counts_half_from_the_row_before(folder):
    (folder / "experiment.toml").write_text(
        HEAD.replace('unit = "mA" }', 'unit = "mA", held = true }'), encoding="utf-8"
    )
    assert read_experiment(folder).runs[0].commands[:3, 0] == pytest.approx([0.100, 0.1005, 0.1015])


def test_counts_may_run_the_other_way(folder):
    (folder / "experiment.toml").write_text(
        HEAD.replace("counts_per_turn = 4000", "counts_per_turn = 4000, sign = -1"),
        encoding="utf-8",
    )
    assert read_experiment(folder).runs[0].signals[3, 1] == pytest.approx(-2.0 * np.pi * 6 / 4000)


def test_the_noise_of_a_signal_is_in_the_unit_of_its_column(folder):
    assert [signal.noise_std for signal in read_experiment(folder).signals] == [
        pytest.approx(0.0005),
        None,
        None,
    ]


def test_a_sensor_is_a_signal_in_its_own_unit(folder):
    sensor = (
        '  { sensor = "plate_z", column = "rate", unit = "mN m", sign = -1, noise_std = 2.0 '
        "},\n]\ncommands"
    )
    (folder / "experiment.toml").write_text(HEAD.replace("]\ncommands", sensor), encoding="utf-8")
    read = read_experiment(folder)
    assert read.signals[3] == RecordedSignal("sensor", "plate_z", "N m", 0.002)
    assert read.runs[0].signals[3, 3] == pytest.approx(-0.27)


def test_the_part_that_counts_is_cut_out(folder):
    (folder / "experiment.toml").write_text(
        HEAD.replace("from_s = 0.005", "from_s = 0.012"), encoding="utf-8"
    )
    assert read_experiment(folder).runs[1].t_s[0] == pytest.approx(0.012)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'unit = "ms"',
            'unit = "minute"',
            "experiment.toml:4: time.unit: should be one of s, ms, us, ns, not 'minute'",
        ),
        (
            'unit = "mm"',
            'unit = "inch"',
            (
                "experiment.toml:5: signals[1]: unit 'inch' of a position should be one of "
                "rad, deg, turn, m, mm, count"
            ),
        ),
        (
            'joint = "pole", quantity = "speed"',
            'sensor = "pole", quantity = "speed"',
            "a signal has a joint with a quantity",
        ),
        (
            'quantity = "speed", column = "rate", unit = "deg/s"',
            'column = "rate", unit = "deg/s"',
            "a signal has a joint with a quantity",
        ),
        (
            'joint = "pole", quantity = "speed", column = "rate", unit = "deg/s"',
            'sensor = "gyro", column = "rate", unit = "count"',
            "unit 'count' of a sensor should be one of",
        ),
        (", counts_per_turn = 4000", "", "counts_per_turn belongs to the unit 'count'"),
        (
            'joint = "cart"',
            'joint = "pole"',
            "experiment.toml:5: signals[2]: pole, position is already signals[1]",
        ),
        (
            'column = "x"',
            'column = "place"',
            "a.csv:1: column place, which is to hold the position of joint cart, is missing",
        ),
        ('file = "b.csv"', 'file = "a.csv"', "recordings[2]: a.csv is already recordings[1]"),
        ('file = "b.csv"', 'file = "c.csv"', "c.csv is not there"),
        ('condition = "free"', 'condition = "slow"', "slow, repeat 1 is already recordings[1]"),
        ("from_s = 0.005", "from_s = 0.5", "0 samples between from_s and to_s"),
        ('title = "cart"', 'titel = "cart"', "title"),
    ],
)
def test_a_fault_is_one_line_that_names_the_place(folder, old, new, said):
    (folder / "experiment.toml").write_text(HEAD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        read_experiment(folder)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("8,3,6,", "8,nan,6,", "a.csv:5: column x: nan is not a value"),
        ("8,3,6,", "7,3,6,", "a.csv:5: time does not run forwards: it has the same time as"),
        ("8,3,6,", "8,,6,", "a.csv:5: column x: the cell is empty"),
    ],
)
def test_a_fault_in_a_file_is_named_with_its_line(folder, old, new, said):
    (folder / "a.csv").write_text(
        "t,x,angle,remark,rate,current\n" + ROWS.replace(old, new, 1), encoding="utf-8"
    )
    with pytest.raises(BadInput) as refused:
        read_experiment(folder)
    assert said in str(refused.value)


def test_lines_with_more_cells_than_columns_are_not_read_askew(folder):
    """As where numbers have a decimal comma: every cell of a needed column would be another's."""
    (folder / "a.csv").write_text(
        "t,x,angle,rate,current\n" + "".join(f"{k},0,{k},0,{k},0,{k},0,{k},0\n" for k in range(20)),
        encoding="utf-8",
    )
    with pytest.raises(
        BadInput,
        match=(
            r"a\.csv:2: 10 cells in the line for 5 columns in the header; do its numbers have "
            r"a decimal comma"
        ),
    ):
        read_experiment(folder)


def test_it_stands_alone(folder):
    assert experiment_among([folder]) == folder
    assert experiment_among([folder / "a.csv"]) is None
    with pytest.raises(BadInput, match="give it alone"):
        experiment_among([folder, folder / "a.csv"])
