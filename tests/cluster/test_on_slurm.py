"""Commands on a real SLURM of one node, which the test sets up and takes down."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rfca_rig.cli.commands import prove
from tests.cli.typed import typed
from tests.cluster.slurm_node import missing, slurm_node
from tests.exam_cases.examinees import wants_more_data
from tests.executors.test_cluster import content

ROOT = Path(__file__).parents[2]
EXAM = ("--seed", "2", "--kind", "poor data", "--cases", "2")
SWEEP = ("--vary", "height_mm=215:235:5", "--set", "speed_rad_s=2.4", "--outputs", "valley_fz_N")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(missing() is not None, reason=missing() or ""),
    pytest.mark.timeout(300),
]


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    try:
        with slurm_node(tmp_path_factory.mktemp("slurm") / "node"):
            yield
    except RuntimeError as reason:
        pytest.skip(str(reason))


@pytest.fixture
def cluster(node, tmp_path, monkeypatch):
    """The option for two workers in two jobs; jobs run where they were submitted, and find the
    tests there.
    """
    monkeypatch.chdir(ROOT)
    file = tmp_path / "cluster.toml"
    file.write_text(
        'scheduler = "slurm"\njobs = 2\nmemory_per_worker_MB = 1000\ntime = "00:10:00"\n'
    )
    return ("--cluster", f"slurm:{file}")


def running() -> str:
    return subprocess.run(
        ["squeue", "--noheader", "--states=RUNNING,PENDING"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def none_left() -> bool:
    until = time.monotonic() + 30.0
    while running():
        if time.monotonic() > until:
            return False
        time.sleep(0.2)
    return True


def test_an_exam_has_the_same_bytes_as_here_and_leaves_no_job(
    monkeypatch, capsys, tmp_path, cluster
):
    monkeypatch.setattr(prove, "diagnose_as_typed", wants_more_data)
    for name, words in (("here", ("--workers", 1)), ("there", cluster)):
        said = typed(monkeypatch, capsys, "prove", "--out", tmp_path / name, *EXAM, *words)
        assert said.exit_code == 0
    assert content(tmp_path / "here") == content(tmp_path / "there")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cluster.toml", "here", "there"]
    assert none_left()


def test_a_sweep_has_the_same_bytes_as_here(monkeypatch, capsys, tmp_path, cluster):
    for name, words in (("here", ("--workers", 1)), ("there", cluster)):
        said = typed(monkeypatch, capsys, "sweep", *SWEEP, "--out", tmp_path / name, *words)
        assert said.exit_code == 0, said.err
    for name in ("sweep.csv", "sweep.h5"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    assert none_left()


def hanging_command(out: Path, cluster: tuple[str, ...]) -> subprocess.Popen:
    """An exam that has got as far as a case that takes a minute."""
    words = [
        sys.executable,
        "-m",
        "tests.exam_cases.examinees",
        "prove",
        "--out",
        str(out),
        *EXAM,
        *cluster,
    ]
    command = subprocess.Popen(
        words, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    until = time.monotonic() + 120.0
    while not list(out.glob("diagnoses/.case-0002.*/pid")):
        assert command.poll() is None and time.monotonic() < until
        time.sleep(0.1)
    return command


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["^C", "asked to end"])
def test_a_stopped_command_takes_its_jobs_along(tmp_path, cluster, how):
    command = hanging_command(tmp_path / "exam", cluster)
    command.send_signal(how)
    _, said = command.communicate(timeout=60)
    assert command.returncode == 130 and "the same command goes on where it stood" in said
    assert none_left()


def test_jobs_that_were_ended_in_the_middle_end_the_command(tmp_path, cluster):
    command = hanging_command(tmp_path / "exam", cluster)
    subprocess.run(["scancel", "--name=rfca-rig"], check=True)
    _, said = command.communicate(timeout=60)
    assert (
        command.returncode == 1
        and "all jobs of SLURM's job" in said
        and "the same command goes on where it stood" in said
    )


def test_jobs_that_cannot_start_workers_end_the_command_with_their_words(
    monkeypatch, capsys, tmp_path, cluster
):
    file = tmp_path / "cluster.toml"
    file.write_text(
        file.read_text() + 'setup = ["echo there is an error in the module file", "exit 3"]\n'
    )
    said = typed(monkeypatch, capsys, "prove", "--out", tmp_path / "exam", *EXAM, *cluster)
    assert (
        said.exit_code == 1
        and "all jobs of SLURM's job" in said.err
        and "error in the module file" in said.err
    )
    assert len(said.err.splitlines()) == 2  # the job's number, and why it came to nothing
