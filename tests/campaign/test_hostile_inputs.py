"""Hostile models, TOML files, tables, CAN logs and bags end in one line, within the limits of time
and memory.
"""

import os
import resource
import time

import numpy as np
import pytest

from rfca_rig.campaign.layout import ExperimentFile
from rfca_rig.campaign.recorded_files import list_columns
from rfca_rig.errors import BadInput
from rfca_rig.executors.parallel import CAN_COPY
from rfca_rig.executors.reading import MEMORY_VARIABLE, TIME_VARIABLE, read_within_limits
from rfca_rig.mechanism import load
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.toml import read_toml
from tests.campaign.hostile_inputs import BAGS, CAN_LOGS, MODELS, TABLES, TOMLS, model

READERS = {
    "model.xml": (MODELS, load_mechanism),
    "experiment.toml": (TOMLS, lambda path: read_toml(path, ExperimentFile)),
    "run.csv": (TABLES, list_columns),
    "run.mcap": (BAGS, list_columns),
    "run.blf": (CAN_LOGS, lambda path: list_columns(path, [path.with_suffix(".dbc")])),
}
CASES = [
    pytest.param(name, kind, id=f"{name}, {kind}")
    for name, (kinds, _) in READERS.items()
    for kind in kinds
]
pytestmark = pytest.mark.skipif(not CAN_COPY, reason="limits need a copy of the process")


def test_a_hundred_inputs_are_tried():
    assert len(CASES) >= 100


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_a_hostile_input_ends_in_one_line(tmp_path, monkeypatch, name, kind):
    # Those that would take longer must not take the test's time.
    monkeypatch.setenv(TIME_VARIABLE, "3")
    kinds, read = READERS[name]
    path = tmp_path / name
    kinds[kind](path)
    before_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began_s = time.process_time()
    try:
        read(path)
    except BadInput as error:
        assert "\n" not in str(error)
        # A CAN log has its database beside it.
        assert str(error).startswith((str(path), str(path.with_suffix(".dbc"))))
    # What is harmless may be read.
    assert time.process_time() - began_s < 15.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kB < 2_500_000


def test_a_result_and_an_error_come_back(tmp_path):
    path = tmp_path / "file"
    values = read_within_limits(path, lambda: np.arange(3_000_000))
    assert (values == np.arange(3_000_000)).all()

    def refuse() -> None:
        raise BadInput("file:3: no number")

    with pytest.raises(BadInput, match=r"^file:3: no number$"):
        read_within_limits(path, refuse)


class Unreadable(Exception):
    """An error of a library that pickle cannot make again."""

    def __init__(self, expected, actual):
        super().__init__(f"{expected} and {actual}")


def test_the_words_of_a_refusal_arrive_whatever_caused_it(tmp_path):
    """As with a library that has pickle keep the causes of errors."""

    def refuse():
        try:
            raise Unreadable(1, 2)
        except Unreadable as error:
            raise BadInput(f"{tmp_path}: its sum is wrong", error) from error

    with pytest.raises(BadInput, match="its sum is wrong"):
        read_within_limits(tmp_path, refuse)


def wait() -> None:
    time.sleep(60.0)


def take_memory() -> None:
    np.ones(2**29)


def crash() -> None:
    os.abort()


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (wait, "takes more than 0.2 s to read"),
        (take_memory, "cannot be read within 1 GiB of memory"),
        (crash, "ends the program that reads it"),
    ],
)
def test_limits_end_a_copy_with_one_line_that_names_the_keys(tmp_path, monkeypatch, read, said):
    monkeypatch.setenv(TIME_VARIABLE, "0.2" if read is wait else "60")
    monkeypatch.setenv(MEMORY_VARIABLE, "1")
    with pytest.raises(BadInput) as refused:
        read_within_limits(tmp_path / "file", read)
    assert str(refused.value).startswith(f"{tmp_path / 'file'}: ")
    assert said in str(refused.value)
    assert str(refused.value).endswith(f"raise {TIME_VARIABLE} or {MEMORY_VARIABLE}")


def test_a_key_raises_the_limit(tmp_path, monkeypatch):
    monkeypatch.setenv(TIME_VARIABLE, "60")
    monkeypatch.setenv(MEMORY_VARIABLE, "6")
    assert read_within_limits(tmp_path / "file", lambda: np.zeros(2**29).size) == 2**29


@pytest.mark.parametrize("text", ["nan", "-1", "0", "many", "inf"])
def test_a_limit_that_is_none_is_refused(tmp_path, monkeypatch, text):
    monkeypatch.setenv(TIME_VARIABLE, text)
    with pytest.raises(BadInput, match=f"{TIME_VARIABLE} is '{text}'; set it to a number above 0"):
        read_within_limits(tmp_path / "file", wait)


def test_a_plain_model_is_read_without_a_copy(tmp_path, monkeypatch):
    path = tmp_path / "model.xml"
    monkeypatch.setattr("os.fork", lambda: pytest.fail("a copy of the process"))
    model()(path)
    assert load_mechanism(path).joints == ("j",)


@pytest.mark.parametrize(
    "kind",
    [
        "include a pipe",
        "replicate 100000000",
        "300,000 keyframes",
        "nuser_body 1e9",
        "hfield 60000",
        "mesh of 20 GB",
        "flexcomp 1e4 cubed",
    ],
)
def test_a_model_that_stands_for_more_than_itself_is_read_in_a_copy(tmp_path, monkeypatch, kind):
    path = tmp_path / "model.xml"
    MODELS[kind](path)
    monkeypatch.setattr(load, "read_within_limits", lambda *_: "in a copy")
    assert load_mechanism(path) == "in a copy"


@pytest.mark.parametrize("kind", ["include a pipe", "mesh from a pipe", "mesh from a device"])
def test_a_pipe_that_a_model_names_is_not_waited_for(tmp_path, kind):
    path = tmp_path / "model.xml"
    MODELS[kind](path)
    began_s = time.process_time()
    with pytest.raises(BadInput, match=r"^\S+: names \S+, a device or a pipe; name a file$"):
        load_mechanism(path)
    assert time.process_time() - began_s < 5.0
