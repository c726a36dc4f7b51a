"""The same bytes in the end: with any number of workers, in any order, stopped anyhow; what
fails is a row.
"""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.executors.mapping import InProcessExecutor, TaskExecutor, WorkerLost, process_executor
from rfca_rig.progress import ignore_named_progress
from rfca_rig.recording.hdf5_file import read_seal
from rfca_rig.sweep import outputs
from rfca_rig.sweep.carrying_out import Pace, Shards, find_gaps, measure_pace, run_sweep, split_gaps
from rfca_rig.sweep.outputs import Output
from rfca_rig.sweep.result import CaseRange, compute, read_result
from tests.sweep.sweeps import Slow, content, small_plan

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken") / "sweep"
    return run_sweep(small_plan(), folder, InProcessExecutor(), Slow, ignore_named_progress), folder


class Backwards(TaskExecutor):
    """Does nothing until it has all of it, then the last first."""

    at_once = workers = 1000

    def __init__(self, pieces: int) -> None:
        self._left = pieces
        self._waiting = []

    def submit(self, fn, /, *args, **_):
        future: Future = Future()
        self._waiting.append((future, fn, args))
        if len(self._waiting) == self._left:
            for waiting, work, given in reversed(self._waiting):
                waiting.set_result(work(*given))
        return future


class Losing(InProcessExecutor):
    """Whoever does case 7 dies of it."""

    def submit(self, fn, /, *args, **kwargs):
        if any(span.first <= 7 < span.last for span in args[0]):
            future: Future = Future()
            future.set_exception(WorkerLost("its process was ended from outside"))
            return future
        return super().submit(fn, *args, **kwargs)


@pytest.mark.slow
def test_workers_change_no_byte(unbroken, tmp_path):
    with process_executor(2) as two:
        run_sweep(small_plan(), tmp_path / "sweep", two, Slow, ignore_named_progress)
    assert content(tmp_path / "sweep") == content(unbroken[1])
    assert sorted(path.name for path in (tmp_path / "sweep").iterdir()) == [
        "plan.json",
        "sweep.csv",
        "sweep.h5",
    ]


def test_order_changes_no_byte(unbroken, tmp_path):
    size = measure_pace(small_plan(), Slow()).cases_per_shard
    told = []
    pieces = len(split_gaps([CaseRange(0, 12)], size))
    assert pieces > 2
    run_sweep(
        small_plan(), tmp_path / "sweep", Backwards(pieces), Slow, lambda *done: told.append(done)
    )
    assert content(tmp_path / "sweep") == content(unbroken[1])
    assert told[0] == ("cases", 0, 12) and told[-1] == ("cases", 12, 12)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "^C"])
def test_a_stopped_sweep_goes_on_where_it_stood_to_the_same_bytes(unbroken, tmp_path, how):
    out = tmp_path / "sweep"
    if how == "kill":
        process = subprocess.Popen([sys.executable, "-m", "tests.sweep.sweeps", str(out)], cwd=ROOT)
        until = time.monotonic() + 60.0
        while not list(out.glob("shards/*.h5")):
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
        process.wait(timeout=120)
    else:
        with pytest.raises(KeyboardInterrupt):
            run_sweep(small_plan(), out, InProcessExecutor(), Slow, stopped_after(4))
    kept = {path: path.stat().st_mtime_ns for path in out.glob("shards/*.h5")}
    computed = sum(len(span_of(path)) for path in kept)
    assert 0 < computed < 12 and not (out / "sweep.h5").exists()
    told = []
    run_sweep(small_plan(), out, InProcessExecutor(), Slow, lambda *done: told.append(done))
    assert content(out) == content(unbroken[1])
    assert told[0] == ("cases", computed, 12)


def stopped_after(cases: int):
    def told(what, done, of):
        if done >= cases:
            raise KeyboardInterrupt

    return told


def test_a_finished_sweep_is_read_and_not_computed(unbroken):
    result, folder = unbroken
    told = []
    again = run_sweep(
        small_plan(), folder, InProcessExecutor(), Slow, lambda *done: told.append(done)
    )
    assert told == [] and again.remarks == result.remarks
    np.testing.assert_array_equal(again.values, result.values)


def test_what_fails_is_a_row_with_its_reason(unbroken):
    result, folder = unbroken
    rows = list(csv.DictReader((folder / "sweep.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 12 and [row["case"] for row in rows] == [str(case) for case in range(12)]
    limp = [
        row for row in rows if row["strip.thickness_mm"] == "0.02" and row["height_mm"] != "400"
    ]
    assert limp and all("no rest pose found" in row["remark"] or row["energy_J"] for row in limp)
    high = next(
        row for row in rows if row["height_mm"] == "400" and row["strip.thickness_mm"] == "0.8"
    )
    assert (
        high["valley_fz_N"] == ""
        and float(high["energy_J"]) != 0.0
        and "no valley" in high["remark"]
    )
    fine = next(
        row for row in rows if row["height_mm"] == "215" and row["strip.thickness_mm"] == "0.8"
    )
    assert float(fine["valley_fz_N"]) < -30.0 and fine["remark"] == ""
    assert result.failed + result.incomplete == sum(bool(remark) for remark in result.remarks)
    assert result.mistakes == 0


def test_a_mistake_in_one_case_and_a_poisonous_case_are_rows(unbroken, tmp_path, monkeypatch):
    broken = Output(lambda case: 1.0 / (round(case.design.height_m, 6) - 0.235), "", "", "")
    monkeypatch.setitem(outputs.OUTPUTS, "energy_J", broken)
    rows = compute(small_plan(), CaseRange(4, 9))
    assert [("mistake in rfca-rig: ZeroDivisionError" in remark) for remark in rows.remarks] == [
        True
    ] * 4 + [False]
    monkeypatch.undo()
    result = run_sweep(small_plan(), tmp_path / "sweep", Losing(), Slow, ignore_named_progress)
    assert np.isnan(result.values[7]).all() and "2 workers were lost over it" in result.remarks[7]
    others = [case for case in range(12) if case != 7]
    np.testing.assert_array_equal(result.values[others], unbroken[0].values[others])


def test_another_sweep_in_the_folder_is_refused(unbroken, tmp_path, monkeypatch):
    _, folder = unbroken
    plan = small_plan()
    object.__setattr__(plan, "outputs", plan.outputs[:1])
    with pytest.raises(
        BadInput,
        match=(
            "holds a sweep with another outputs; give a new folder with --out, or remove this one"
        ),
    ):
        run_sweep(plan, folder, InProcessExecutor(), Slow, ignore_named_progress)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(BadInput, match=r"holds notes.txt, which is of no sweep"):
        run_sweep(small_plan(), tmp_path, InProcessExecutor(), Slow, ignore_named_progress)
    found = json.loads((folder / "plan.json").read_text())
    other = tmp_path / "older"
    other.mkdir()
    (other / "plan.json").write_text(
        json.dumps({**found, "made_with": {**found["made_with"], "numpy": "1.0"}})
    )
    with pytest.raises(
        BadInput, match="its sweep was made with another numpy, and results would not fit together"
    ):
        run_sweep(small_plan(), other, InProcessExecutor(), Slow, ignore_named_progress)


@pytest.mark.skipif(os.name == "nt", reason="without locks")
def test_two_at_once_in_one_folder_are_one_too_many(tmp_path):
    shards = Shards(tmp_path, "")
    with shards.lock(), pytest.raises(BadInput, match="still going on"), shards.lock():
        pass


def test_a_damaged_shard_and_one_of_another_sweep_are_named(tmp_path):
    out = tmp_path / "sweep"
    with pytest.raises(KeyboardInterrupt):
        run_sweep(small_plan(), out, InProcessExecutor(), Slow, stopped_after(1))
    shard = next(out.glob("shards/*.h5"))
    whole = shard.read_bytes()
    shard.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        BadInput,
        match=rf"{shard.name}: cannot be read .*; remove it, and its cases are computed again",
    ):
        run_sweep(small_plan(), out, InProcessExecutor(), Slow, ignore_named_progress)
    shard.unlink()
    Shards(out, "of another plan").write(span_of(shard), compute(small_plan(), span_of(shard)))
    with pytest.raises(BadInput, match=rf"{shard.name}: is of another sweep; remove it"):
        run_sweep(small_plan(), out, InProcessExecutor(), Slow, ignore_named_progress)


def span_of(shard: Path) -> CaseRange:
    return CaseRange(*map(int, shard.stem.split("-")[1:]))


def test_sweep_h5_says_what_it_holds(unbroken):
    result, folder = unbroken
    assert read_seal(folder / "sweep.h5")
    with h5py.File(folder / "sweep.h5") as file:
        assert (
            file.attrs["title"] == result.plan.title
            and json.loads(file.attrs["plan"])["format"] == "rfca-sweep/1"
        )
        np.testing.assert_array_equal(file["height_mm"][()], np.repeat([215.0, 235.0, 400.0], 4))
        np.testing.assert_array_equal(file["energy_J"][()], result.values[:, 1])
        assert file["energy_J"].attrs["long_name"].startswith("energy per stroke: W =")
    assert read_result(result.plan, folder).failed == result.failed


def test_gaps_and_pieces():
    there = [CaseRange(2, 4), CaseRange(6, 9)]
    assert find_gaps(10, there) == [CaseRange(0, 2), CaseRange(4, 6), CaseRange(9, 10)]
    assert find_gaps(9, [CaseRange(0, 9)]) == []
    assert split_gaps([CaseRange(0, 5), CaseRange(7, 8)], 2) == [
        CaseRange(0, 2),
        CaseRange(2, 4),
        CaseRange(4, 5),
        CaseRange(7, 8),
    ]
    assert Pace(0.004).cases_per_shard * 0.004 >= 1.0
