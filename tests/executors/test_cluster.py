"""The same work by workers of a Dask scheduler, processes of their own: same bits, and what
becomes of it when one is lost.
"""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rfca_rig.cli.commands import prove
from rfca_rig.errors import BadInput
from rfca_rig.executors.cluster import connect_to_scheduler
from rfca_rig.executors.environment import EnvironmentCheck
from rfca_rig.executors.mapping import InProcessExecutor, TaskFailure, map_unordered
from rfca_rig.progress import ignore_named_progress
from tests.cli.typed import typed
from tests.exam_cases.examinees import wants_more_data
from tests.executors import work
from tests.executors.test_mapping import begun, kill_the_one_at

distributed = pytest.importorskip(
    "distributed", reason='needs dask.distributed: pip install "rfca-rig[cluster]"'
)

ROOT = Path(__file__).parents[2]
EXAM = ("--seed", 2, "--kind", "poor data", "--cases", 2)


@pytest.fixture(scope="module")
def address():
    """A scheduler with two workers that are processes of their own, started again when they are
    lost.
    """
    asked = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": "127.0.0.1:0",
        "silence_logs": 60,
    }
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(
            "HANGS_S", "1"
        )  # a worker goes on with what it has begun when the command that wanted it was killed
        with distributed.LocalCluster(**asked, scheduler_kwargs={"allowed_failures": 0}) as cluster:
            yield cluster.scheduler_address


@pytest.fixture(scope="module")
def workers(address):
    with connect_to_scheduler(address, None, work.facts, ignore_named_progress, print) as executor:
        executor.retry_delay_s = 0.5
        yield executor


@pytest.mark.slow
def test_the_same_bits_as_here(workers):
    seeds = range(12)
    here = work.digest(dict(map_unordered(InProcessExecutor(), work.stroke, seeds)))
    assert work.digest(dict(map_unordered(workers, work.stroke, seeds))) == here


@pytest.mark.slow
def test_workers_use_one_thread_each(workers):
    assert {told for _, told in map_unordered(workers, work.threads, range(4))} == {(1, "1")}


@pytest.mark.slow
def test_a_killed_worker_costs_the_piece_that_it_had(workers, tmp_path):
    killer = threading.Thread(target=kill_the_one_at, args=(tmp_path / "2",))
    killer.start()
    pieces = [(tmp_path, number) for number in range(6)]
    results = {
        number: result
        for (_, number), result in map_unordered(workers, work.waits_to_be_killed_at_two, pieces)
    }
    killer.join()
    assert results == {number: 10 * number for number in range(6)}
    assert begun(tmp_path) == {0: 1, 1: 1, 2: 2, 3: 1, 4: 1, 5: 1}


@pytest.mark.slow
def test_a_piece_that_ends_its_worker_twice_is_given_up_and_the_rest_is_done(workers):
    results = dict(map_unordered(workers, work.kills_at_three, range(6)))
    failed = results.pop(3)
    assert results == {number: 10 * number for number in (0, 1, 2, 4, 5)}
    assert isinstance(failed, TaskFailure) and failed.reason.startswith(
        "2 workers were lost over it"
    )


def content(exam: Path) -> dict[str, bytes]:
    """All files of an exam but those that tell how long it took."""
    files = [
        path
        for folder in ("campaigns", "diagnoses", "sealed")
        for path in (exam / folder).rglob("*")
        if path.is_file()
    ]
    return {
        str(path.relative_to(exam)): path.read_bytes()
        for path in files
        if path.name != "seconds.txt"
    }


@pytest.mark.long
def test_an_exam_has_the_same_bytes_by_processes_and_by_a_cluster(
    monkeypatch, capsys, tmp_path, address
):
    monkeypatch.setattr(prove, "diagnose_as_typed", wants_more_data)
    for name, words in (("here", ("--workers", 1)), ("there", ("--cluster", address))):
        said = typed(monkeypatch, capsys, "prove", "--out", tmp_path / name, *EXAM, *words)
        assert (said.exit_code, said.err) == (
            0,
            f"{tmp_path / name / 'exam.html'}: the whole result\n",
        )
    assert content(tmp_path / "here") == content(tmp_path / "there")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here", "there"]


@pytest.mark.long
def test_an_exam_whose_command_was_killed_goes_on_where_it_stood(
    monkeypatch, capsys, tmp_path, address
):
    out = tmp_path / "exam"
    words = [
        sys.executable,
        "-m",
        "tests.exam_cases.examinees",
        "prove",
        "--out",
        out,
        *EXAM,
        "--cluster",
        address,
    ]
    command = subprocess.Popen(list(map(str, words)), cwd=ROOT)
    first = out / "diagnoses" / "case-0001"
    until = time.monotonic() + 60.0
    while not (first.is_dir() and list(out.glob("diagnoses/.case-0002.*/pid"))):
        assert command.poll() is None and time.monotonic() < until
        time.sleep(0.02)
    command.send_signal(signal.SIGKILL)
    command.wait()
    before = {path: path.stat().st_mtime_ns for path in first.iterdir()}
    monkeypatch.setattr(prove, "diagnose_as_typed", wants_more_data)
    assert (
        typed(monkeypatch, capsys, "prove", "--out", out, *EXAM, "--cluster", address).exit_code
        == 0
    )
    assert {path: path.stat().st_mtime_ns for path in first.iterdir()} == before
    assert (out / "diagnoses" / "case-0002" / "diagnosis.json").is_file()


def other_facts() -> dict[str, str]:
    """As those of here, but for a worker, which is asked in a process of its own."""
    return {
        **work.facts(),
        "numpy": "1.0"
        if "distributed.nanny" in sys.modules and distributed.worker._global_workers
        else "2.0",
    }


@pytest.mark.slow
def test_a_worker_with_another_version_is_refused_in_a_line(address):
    words = r"^the worker on \S+ is not as this process: numpy is 1\.0 there, 2\.0 here$"
    with (
        pytest.raises(BadInput, match=words),
        connect_to_scheduler(address, None, other_facts, ignore_named_progress, print),
    ):
        pass


def test_a_worker_that_does_not_see_the_results_folder_does_not_meet_the_terms(tmp_path):
    facts = {"numpy": "2.0"}
    terms = EnvironmentCheck(facts, str(tmp_path), ".seen-1")
    assert (
        terms.find_differences(facts)
        == f"{tmp_path} is not the same folder there; results must go where all computers see them"
    )
    (tmp_path / ".seen-1").touch()
    assert terms.find_differences(facts) is None


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("--cluster", "tcp://127.0.0.1:9"),
            "--cluster tcp://127.0.0.1:9: no Dask scheduler answers there",
        ),
        (
            ("--cluster", "127.0.0.1:8786"),
            "--cluster 127.0.0.1:8786: should be tcp://HOST:PORT or slurm:FILE",
        ),
        (
            ("--cluster", "tcp://127.0.0.1:9", "--workers", 2),
            "--workers counts processes of this computer",
        ),
        (("--cluster", "slurm:nowhere.toml"), "nowhere.toml: cannot be read"),
    ],
)
def test_a_cluster_that_is_not_there_is_refused_in_a_line(
    monkeypatch, capsys, tmp_path, words, told
):
    monkeypatch.setattr("rfca_rig.executors.cluster.CONNECT_S", 0.5)
    said = typed(monkeypatch, capsys, "prove", "--out", tmp_path / "exam", *words)
    assert said.exit_code == 2 and len(said.err.splitlines()) == 1 and told in said.err
    assert not (tmp_path / "exam").exists()
