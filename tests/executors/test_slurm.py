"""What SLURM is asked for, and what is said where it refuses or is not there. A real one:
tests/cluster.
"""

import subprocess
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.executors.slurm import JobArray, read_cluster_file
from tests.cli.typed import typed

FILE = 'scheduler = "slurm"\njobs = 3\ntime = "02:00:00"\n'


def cluster_file(folder: Path, text: str) -> Path:
    path = folder / "cluster.toml"
    path.write_text(text)
    return path


def test_a_file_says_what_to_ask_for(tmp_path):
    more = (
        'workers_per_job = 16\nmemory_per_worker_MB = 1500\npartition = "long"\naccount = '
        '"legs"\nsetup = ["module load python"]\n'
    )
    array = read_cluster_file(cluster_file(tmp_path, FILE + more + 'options = ["--qos=night"]\n'))
    lines = array.script("tls://10.0.0.1:4000", tmp_path / "with space").splitlines()
    asked = {line.removeprefix("#SBATCH --") for line in lines if line.startswith("#SBATCH")}
    assert {
        "array=0-2",
        "cpus-per-task=16",
        "mem=24500M",
        "time=02:00:00",
        "partition=long",
        "account=legs",
        "qos=night",
    } <= asked
    worker = next(line for line in lines if line.startswith("exec "))
    assert lines.index("module load python") < lines.index(worker)
    assert (
        "tls://10.0.0.1:4000 --nworkers 16 --nthreads 1 --memory-limit 1500MB --death-timeout 60"
        in worker
    )
    assert array.workers == 48


def test_the_script_is_one_for_the_shell(tmp_path):
    script = JobArray(2, 1, 2000, "10").script("tls://10.0.0.1:4000", tmp_path / "it's here")
    assert subprocess.run(["bash", "-n"], input=script, text=True, check=False).returncode == 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            FILE.replace("jobs = 3", "jobs = 0"),
            "cluster.toml:2: jobs: should be greater than or equal to 1, not 0",
        ),
        (FILE.replace("time", "tine"), "cluster.toml:3: tine: unknown key; did you mean time?"),
        (FILE.replace("02:00:00", "two hours"), "cluster.toml:3: time: "),
        (FILE.replace('"slurm"', '"pbs"'), "cluster.toml:1: scheduler: should be 'slurm'"),
        (FILE + 'options = ["qos=night"]\n', "cluster.toml:4: options[1]: "),
        (FILE + 'partition = "a b"\n', "cluster.toml:4: partition: "),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_a_line(tmp_path, text, told):
    with pytest.raises(BadInput) as refused:
        read_cluster_file(cluster_file(tmp_path, text))
    assert told in str(refused.value) and "\n" not in str(refused.value)


def sbatch(folder: Path, text: str) -> None:
    folder.mkdir()
    (folder / "sbatch").write_text(f"#!/bin/sh\n{text}\n")
    (folder / "sbatch").chmod(0o755)


def prove(monkeypatch, capsys, tmp_path):
    file = cluster_file(tmp_path, FILE)
    return typed(
        monkeypatch,
        capsys,
        "prove",
        "--out",
        tmp_path / "exam",
        "--cases",
        1,
        "--cluster",
        f"slurm:{file}",
    )


def test_no_sbatch_here_is_told(monkeypatch, capsys, tmp_path):
    pytest.importorskip("distributed")
    monkeypatch.setenv("PATH", str(tmp_path))
    said = prove(monkeypatch, capsys, tmp_path)
    assert (
        said.exit_code == 2
        and "there is no sbatch on this computer" in said.err
        and len(said.err.splitlines()) == 1
    )


def test_what_sbatch_refuses_is_told_in_its_words(monkeypatch, capsys, tmp_path):
    pytest.importorskip("distributed")
    sbatch(tmp_path / "bin", "echo 'sbatch: error: invalid partition specified: long' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    said = prove(monkeypatch, capsys, tmp_path)
    assert said.exit_code == 2 and said.err.endswith(
        "workers.sbatch: sbatch: error: invalid partition specified: long\n"
    )
    assert len(said.err.splitlines()) == 1 and not (tmp_path / "exam").exists()


def test_a_folder_whose_name_is_more_than_a_line_is_refused(monkeypatch, capsys, tmp_path):
    pytest.importorskip("distributed")
    sbatch(tmp_path / "bin", "exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    folder = tmp_path / "exams\ntouch marker\n#"
    folder.mkdir()
    said = prove(monkeypatch, capsys, folder)
    assert (
        said.exit_code == 2 and "rename the folder" in said.err and len(said.err.splitlines()) == 1
    )
    assert sorted(found.name for found in folder.iterdir()) == ["cluster.toml"]
