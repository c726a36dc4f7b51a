"""report --accept: measured strokes beside the model within tolerances, on the page, in the
terminal, as JSON, and by the exit code.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.description.tolerances_file import read_tolerances
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import write_recording
from rfca_rig.reports.strokes.acceptance import describe_failure, describe_outcome
from rfca_rig.reports.strokes.page import write_report
from tests.cli.typed import typed
from tests.report.recordings import recording, strokes

TOLERANCES = """
[fz]
absolute_N = 2.0
relative_pct = 5
lead_ms = 10
lag_ms = 10
phases = ["free", "touchdown", "loading"]

[valley]
time_error_pct = 1
force_error_pct = 2
"""


@pytest.fixture
def tolerances(tmp_path):
    path = tmp_path / "tolerances.toml"
    path.write_text(TOLERANCES)
    return path


def delayed(measured, delay_s):
    """The strokes of a force sensor that is late."""
    late = []
    for stroke in measured:
        streams = {
            name: replace(stream, t_s=stream.t_s + delay_s)
            for name, stream in stroke.streams.items()
        }
        late.append(replace(stroke, streams=streams))
    return late


def compare_within(folder, measured, path):
    return write_report([recording(measured)], folder, tolerances=read_tolerances(path)).tests


def test_the_model_is_accepted_on_its_own_strokes(tmp_path, tolerances):
    tests = compare_within(tmp_path / "out", strokes(), tolerances)
    assert not tests.failed
    # Two conditions with two repeats, and two errors of each valley.
    assert tests.count == 4 + 4
    assert describe_outcome(tests) == "accepted: 8 acceptance tests passed"
    document = json.loads((tmp_path / "out" / "acceptance.json").read_text())
    assert document["accepted"] is True and document["failed"] == 0


def test_a_delay_within_the_time_tolerance_is_accepted_and_a_larger_one_is_not(
    tmp_path, tolerances
):
    signals = tolerances.parent / "signals.toml"
    signals.write_text(TOLERANCES.partition("[valley]")[0])
    assert not compare_within(tmp_path / "near", delayed(strokes(), 0.008), signals).failed
    tests = compare_within(tmp_path / "far", delayed(strokes(), 0.03), signals)
    assert len(tests.failed) == 4


def test_a_failure_says_what_where_when_and_by_how_much(tmp_path, tolerances):
    out = tmp_path / "out"
    tests = compare_within(out, delayed(strokes(), 0.03), tolerances)
    signal = next(test for test in tests.failed if hasattr(test, "signal"))
    words = describe_failure(signal)
    assert f"{signal.source}, 215 mm, 2.433 rad/s, repeat 1: fz is outside at" in words
    assert f"at {signal.t_s:.4f} s by {signal.beyond:.3g} N" in words
    assert f"{signal.outside} of {signal.samples} samples are outside" in words
    # The farthest sample is described as it is.
    outside = signal.lower - signal.simulated, signal.simulated - signal.upper
    assert max(outside) == pytest.approx(signal.beyond)
    valley = next(test for test in tests.failed if hasattr(test, "error_pct"))
    assert "time of the valley is wrong by" in describe_failure(valley)
    assert "limit 1 %" in describe_failure(valley)
    page = (out / "report.html").read_text()
    assert "NOT ACCEPTED" in page and "Acceptance tests" in page
    with (out / "acceptance.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert sum(row["result"] == "FAILED" for row in rows) == len(tests.failed)
    document = json.loads((out / "acceptance.json").read_text(), parse_constant=pytest.fail)
    assert document["signals"][0]["t_s"] == pytest.approx(signal.t_s, abs=1e-6)


def test_a_signal_that_was_not_recorded_is_not_accepted(tmp_path, tolerances):
    bare = []
    for stroke in strokes():
        streams = {}
        for name, stream in stroke.streams.items():
            columns = {key: column for key, column in stream.columns.items() if key != "fz_N"}
            streams[name] = replace(stream, columns=columns)
        bare.append(replace(stroke, streams=streams))
    tests = compare_within(tmp_path / "out", bare, tolerances)
    assert len(tests.failed) == tests.count
    assert any("fz_N was not recorded" in describe_failure(test) for test in tests.failed)


def test_the_command_ends_with_1_where_a_test_fails_and_prints_json(
    tmp_path, monkeypatch, capsys, tolerances
):
    monkeypatch.chdir(tmp_path)
    write_recording(recording(strokes()), tmp_path / "good.h5")
    write_recording(recording(delayed(strokes(), 0.03)), tmp_path / "late.h5")
    good = typed(monkeypatch, capsys, "report", "good.h5", "--accept", tolerances)
    assert good.exit_code == 0, good.err
    assert good.err.splitlines()[-1] == "accepted: 8 acceptance tests passed"
    late = typed(monkeypatch, capsys, "report", "late.h5", "--accept", tolerances)
    assert late.exit_code == 1
    assert "repeat 1: fz is outside at" in late.err
    assert late.err.splitlines()[-1].startswith("rfca-rig: NOT ACCEPTED: ")
    plain = typed(monkeypatch, capsys, "report", "late.h5", "--accept", tolerances, "--json")
    assert plain.exit_code == 1
    document = json.loads(plain.out)
    assert document["format"] == "rfca-table2/1"
    assert document["acceptance"]["accepted"] is False


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "tests nothing; give one or more of [fy], [fz], [tx], [valley]"),
        ("[fz]\nabsolute = 2.0", "fz.absolute: unknown key; did you mean absolute_N?"),
        ("[tx]\nabsolute_N = 2.0", "tx.absolute_N: unknown key; did you mean absolute_Nm?"),
        ("[fz]\nrelative_pct = 150", "fz.relative_pct: should be less than or equal to 100"),
        ("[fz]\nlag_ms = -1", "fz.lag_ms: should be greater than or equal to 0"),
        ('[fz]\nphases = ["impact"]', "fz.phases[1]: should be 'rest', 'free'"),
        ("[valley]", "valley: takes time_error_pct, force_error_pct or both"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, text, message):
    path = tmp_path / "tolerances.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=r"tolerances\.toml") as error:
        read_tolerances(path)
    assert message in str(error.value)


def test_the_example_of_the_documents_is_a_tolerances_file(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "reports.md").read_text(encoding="utf-8")
    path = tmp_path / "tolerances.toml"
    path.write_text(text.partition("```toml\n")[2].partition("```")[0])
    tolerances = read_tolerances(path)
    assert tolerances.fz is not None and tolerances.fz.lag_ms == 15


def test_only_the_phases_that_the_file_names_are_compared(tmp_path, tolerances):
    """A push while the leg is at rest."""
    pushed = []
    for stroke in strokes():
        streams = {}
        for name, stream in stroke.streams.items():
            force = stream.columns["fz_N"]
            data = np.where(np.abs(stream.t_s + 0.05) < 0.013, force.data + 30.0, force.data)
            columns = {**stream.columns, "fz_N": replace(force, data=data)}
            streams[name] = replace(stream, columns=columns)
        pushed.append(replace(stroke, streams=streams))
    assert not compare_within(tmp_path / "some", pushed, tolerances).failed
    tolerances.write_text(TOLERANCES.replace('"free", ', '"rest", "free", '))
    tests = compare_within(tmp_path / "all", pushed, tolerances)
    assert [round(test.t_s, 2) for test in tests.failed] == [-0.05] * 4
