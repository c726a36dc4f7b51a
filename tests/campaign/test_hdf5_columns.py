"""Recordings in HDF5: columns of 1-D and 2-D datasets, and every fault in one line."""

import h5py
import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.errors import BadInput
from tests.campaign.drafts import drafted

HEAD = """format = "rfca-experiment/1"
title = "cart"
model = "model.xml"
time = { column = "log/t", unit = "us" }
signals = [
  { joint = "cart", quantity = "position", column = "/log/x", unit = "mm" },
  { joint = "pole", quantity = "position", column = "state[0]", unit = "deg" },
  { joint = "pole", quantity = "speed", column = "state[1]", unit = "rad/s" },
]
commands = [{ actuator = "push", column = "current", unit = "A" }]
recordings = [{ file = "a.h5", condition = "slow", from_s = 0.003 }]
"""
K = np.arange(20)


def write(path, **changed):
    """A recording; `changed` replaces datasets, or leaves them out where it is None."""
    datasets = {
        "t": 1000 * K,
        "x": K.astype(np.float32),
        "state": np.column_stack([2.0 * K, -K]),
        "current": 0.1 * K,
    } | changed
    places = {"t": "log/t", "x": "log/x"}
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            if values is not None:
                file[places.get(name, name)] = values


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "experiment.toml").write_text(HEAD, encoding="utf-8")
    write(tmp_path / "a.h5")
    return tmp_path


def refusal(folder, head=HEAD):
    (folder / "experiment.toml").write_text(head, encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        read_experiment(folder)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_datasets_and_columns_of_datasets_become_the_model_s(folder):
    (run,) = read_experiment(folder).runs
    assert run.t_s == pytest.approx(0.001 * K[3:])
    assert run.signals[0] == pytest.approx([0.003, np.radians(6.0), -3.0])
    assert run.commands[0] == pytest.approx([0.3])


def test_a_recording_with_motors_off_needs_no_commands(folder):
    (folder / "experiment.toml").write_text(
        HEAD.replace("from_s = 0.003", "driven = false"), encoding="utf-8"
    )
    write(folder / "a.h5", current=None)
    assert not read_experiment(folder).runs[0].commands.any()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"current": None},
            (
                "a.h5: column current, which is to hold the command of actuator push, is "
                "missing; there are log/t, log/x, state"
            ),
        ),
        (
            {"current": 0.1 * K[:-1]},
            "a.h5: column current has 19 samples and log/t has 20; they must be as many",
        ),
        (
            {"current": np.array([b"on"] * 20)},
            (
                "column current, which is to hold the command of actuator push: it holds "
                "|S2, no numbers"
            ),
        ),
        ({"current": np.zeros((20, 3))}, "current has 3 columns; write current[0] to current[2]"),
        (
            {"current": np.zeros((20, 2, 2))},
            "current has 3 dimensions; a column comes from one or two",
        ),
        ({"state": np.zeros((20, 1))}, "state has 1 columns, so the last is state[0]"),
        ({"state": np.zeros(20)}, "state has one dimension; leave [0] out"),
        (
            {"x": np.where(K == 4, np.nan, K)},
            "a.h5: column /log/x: sample 5 is nan; every sample needs a finite number",
        ),
        (
            {"t": np.where(K == 4, 0, 1000 * K)},
            "a.h5: sample 5: time does not run forwards: it is 0.003 s before the sample above",
        ),
    ],
)
def test_a_fault_in_a_file_is_one_line(folder, changed, said):
    write(folder / "a.h5", **changed)
    assert said in refusal(folder)


def test_a_mistyped_dataset_is_one_line_with_what_was_meant(folder):
    said = refusal(folder, HEAD.replace("state[1]", "stat[1]"))
    assert (
        "column stat[1], which is to hold the speed of joint pole, is missing; did you mean state?"
        in said
    )


@pytest.mark.parametrize("content", [b"", b"t,x\n0,1\n", None])
def test_a_file_that_is_no_hdf5_or_is_cut_off_is_refused(folder, content):
    whole = (folder / "a.h5").read_bytes()
    (folder / "a.h5").write_bytes(whole[: len(whole) // 2] if content is None else content)
    assert "a.h5: cannot be read as HDF5: " in refusal(folder)


def test_a_draft_lists_columns_with_their_ranges_and_finds_the_time(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    write(
        folder / "a.h5",
        x=-K,
        current=np.array([b"on"] * 20),
        state=np.column_stack([K % 3, -K]),
        map=np.zeros((20, 80)),
        k=K[:5],
    )
    text = drafted(folder)
    assert "#   log/x: -19 to 0\n#   state[0]: 0 to 2\n#   state[1]: -19 to 0\n" in text
    assert "#   current: no numbers\n" in text
    assert "#   map: 80 columns, which are too many to list\n" in text
    assert "#   k" not in text
    assert '[time]\ncolumn = "log/t"\nunit = "?"' in text
    assert '[[recordings]]\nfile = "a.h5"' in text


def test_a_draft_for_csv_files_leaves_other_files_out_and_says_so(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    write(folder / "a.h5")
    (folder / "b.csv").write_text("t,x\n0,1\n1,1\n", encoding="utf-8")
    text = drafted(folder)
    assert "# Columns of b.csv" in text
    assert "# Left out, as they are of another kind: 1 x HDF5" in text
    assert 'file = "a.h5"' not in text
