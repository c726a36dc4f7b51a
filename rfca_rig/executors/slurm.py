"""Workers in a SLURM job array, with a Dask scheduler inside this process.

Workers that lose their scheduler, because this process was killed, end by themselves within
DEATH_TIMEOUT_S seconds.
"""

import os
import resource
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import rmtree, which
from tempfile import mkdtemp
from typing import Annotated, Any, Literal

from pydantic import Field

from rfca_rig.errors import BadInput, RigError
from rfca_rig.executors.cluster import (
    DaskExecutor,
    WorkerStartup,
    connect_workers,
    import_distributed,
)
from rfca_rig.executors.cores import ONE_THREAD
from rfca_rig.executors.environment import Facts
from rfca_rig.executors.termination import interrupt_on_termination
from rfca_rig.progress import ProgressReport
from rfca_rig.subprocesses import SAFE_PATH_VARIABLE, python_command
from rfca_rig.toml import Section, read_toml

DEATH_TIMEOUT_S = 60
# Memory of the process that supervises the workers of a job.
SUPERVISOR_MEMORY_MB = 500
SCRIPT = "workers.sbatch"
KEYS = "keys.pem"

# These values go into a batch script: no blanks, separators or line breaks may change its meaning.
Word = Annotated[str, Field(pattern=r"^[^\s,;]+$")]
Line = Annotated[str, Field(pattern=r"^[^\n]+$")]


@dataclass(frozen=True)
class JobArray:
    """`jobs` equal jobs with `workers_per_job` single-threaded workers each; a core and
    `memory_per_worker_MB` per worker.

    `time` is in the format of sbatch. `setup` are shell lines before the workers start, `options`
    further options of sbatch, for example --qos=long. `interface` names the network over which
    workers reach this computer, if it has several.
    """

    jobs: int
    workers_per_job: int
    memory_per_worker_MB: int
    time: str
    partition: str | None = None
    account: str | None = None
    setup: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    python: str = sys.executable
    interface: str | None = None

    @property
    def workers(self) -> int:
        """Number of workers in all jobs."""
        return self.jobs * self.workers_per_job

    def script(self, address: str, folder: Path) -> str:
        """The batch script. `folder` holds the keys and receives the output of the jobs."""
        values = {
            "job-name": "rfca-rig",
            "array": f"0-{self.jobs - 1}",
            "ntasks": "1",
            "cpus-per-task": f"{self.workers_per_job}",
            "mem": f"{self.workers_per_job * self.memory_per_worker_MB + SUPERVISOR_MEMORY_MB}M",
            "time": self.time,
            "partition": self.partition,
            "account": self.account,
            "output": f"{folder}/%A_%a.log",
        }
        options = [f"--{name}={value}" for name, value in values.items() if value is not None]
        lines = [
            "#!/bin/bash",
            *(f"#SBATCH {option}" for option in (*options, *self.options)),
            *(f"export {name}={value}" for name, value in ONE_THREAD.items()),
            # A worker starts further processes, which import nothing from the folder of the job
            # either.
            f"export {SAFE_PATH_VARIABLE}=1",
            # Compiled code is cached on the node's own disk.
            (
                "export NUMBA_CACHE_DIR="
                '"${NUMBA_CACHE_DIR:-${SLURM_TMPDIR:-${TMPDIR:-/tmp}}/rfca-rig-$(id -u)}"'
            ),
            *self.setup,
            shlex.join(
                [
                    *(
                        "exec",
                        *python_command(
                            "-m", "distributed.cli.dask_worker", address, python=self.python
                        ),
                    ),
                    *(
                        "--nworkers",
                        f"{self.workers_per_job}",
                        "--nthreads",
                        "1",
                        "--memory-limit",
                        f"{self.memory_per_worker_MB}MB",
                    ),
                    *(
                        "--death-timeout",
                        f"{DEATH_TIMEOUT_S}",
                        "--no-dashboard",
                        "--local-directory",
                        "/tmp",
                    ),
                    *(f"--tls-{part}={folder / KEYS}" for part in ("ca-file", "cert", "key")),
                ]
            ),
        ]
        return "\n".join(lines) + "\n"


@contextmanager
def slurm_workers(
    array: JobArray,
    shared: Path,
    folder: Path | None,
    facts: Callable[[], Facts],
    report_progress: ProgressReport,
    notice: Callable[[str], None],
) -> Iterator[DaskExecutor]:
    """Executor on the workers of a job array, which is cancelled whenever the block ends.

    Script, keys and output of the jobs are in a new folder in `shared`, which is kept if the block
    ends with an error.
    """
    import_distributed()
    if which("sbatch") is None:
        raise BadInput(
            "--cluster slurm:FILE: there is no sbatch on this computer; type this where "
            "jobs are submitted"
        )
    if not str(shared.resolve()).isprintable():
        # A line break in it would begin a new line of the jobs' script.
        raise BadInput(
            f"{shared}: has a line break or another character in its path that no script "
            "of SLURM can hold; rename the folder"
        )
    job_folder = Path(mkdtemp(prefix="rfca-rig-jobs-", dir=shared)).resolve()
    with _scheduler(array.interface, job_folder / KEYS) as scheduler:
        (job_folder / SCRIPT).write_text(
            array.script(scheduler.scheduler_address, job_folder), encoding="utf-8"
        )
        with (
            interrupt_on_termination(),
            _submit(job_folder / SCRIPT) as job,
            connect_workers(
                scheduler,
                folder,
                facts,
                WorkerStartup(
                    array.workers, report_progress, partial(_check_job_alive, job, job_folder)
                ),
            ) as executor,
        ):
            notice(f"SLURM has job {job}, {array.jobs} times {array.workers_per_job} workers")
            executor.wait_for_first()
            executor.check(notice)
            yield executor
    rmtree(job_folder)


@contextmanager
def _scheduler(interface: str | None, keys: Path) -> Iterator[Any]:
    """Starts a scheduler in this process, with its own TLS keys: other users can neither submit
    nor see tasks.
    """
    # Raises the limit of open files: the usual one is too low for the connections of a thousand
    # workers.
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    security = import_distributed().Security.temporary()
    # The permissions are set before the key is written.
    keys.touch(mode=0o600)
    keys.write_text(f"{security.tls_client_key}{security.tls_client_cert}", encoding="utf-8")
    try:
        cluster = import_distributed().LocalCluster(
            n_workers=0,
            processes=True,
            host=None if interface else str(import_distributed().utils.get_ip()),
            interface=interface,
            protocol="tls://",
            security=security,
            dashboard_address="127.0.0.1:0",
            # A lost worker fails its task at once; `map_unordered` decides about a retry.
            scheduler_kwargs={"allowed_failures": 0},
        )
    except (OSError, ValueError, RuntimeError) as error:
        raise BadInput(
            "the scheduler for the workers cannot "
            f"listen{f' on {interface}' if interface else ''}: {error}"
        ) from None
    with cluster:
        yield cluster


@contextmanager
def _submit(script: Path) -> Iterator[str]:
    """Submits the job array and cancels it in the end; yields its job number."""
    sbatch = _run_command("sbatch", "--parsable", str(script))
    if sbatch.returncode:
        first_line = next(
            (line.strip() for line in sbatch.stderr.splitlines() if line.strip()),
            "it gave no reason",
        )
        raise BadInput(f"sbatch refused {script}: {first_line}")
    job = sbatch.stdout.strip().split(";")[0]
    try:
        yield job
    finally:
        _run_command("scancel", job)


def _check_job_alive(job: str, folder: Path) -> None:
    """Raises RigError if all jobs of the array have ended."""
    squeue = _run_command("squeue", "--noheader", "--format=%i", f"--jobs={job}")
    # SLURM forgets a job some time after its end.
    is_forgotten = "Invalid job id" in squeue.stderr
    if is_forgotten or (squeue.returncode == 0 and not squeue.stdout.strip()):
        # The last line with an error that a job printed, and the folder of the logs.
        lines = [
            line
            for log in sorted(folder.glob("*.log"))
            for line in log.read_text(encoding="utf-8", errors="replace").splitlines()
        ]
        errors = [line for line in lines if "rror" in line] or lines
        if errors:
            last_error = f"as {errors[-1].strip()!r} in {folder}"
        else:
            last_error = f"without a word in {folder}"
        raise RigError(
            f"all jobs of SLURM's job {job} have ended, {last_error}; the same command "
            "goes on where it stood"
        )


def _run_command(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(words, capture_output=True, text=True, check=False, env=_environment())


def _environment() -> dict[str, str]:
    """Environment without the SLURM variables of a job that this process may run in: the workers
    are separate jobs.
    """
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("SLURM_") or name == "SLURM_CONF"
    }


class ClusterFile(Section):
    """`jobs` jobs of `workers_per_job` workers each. A worker is a process of one thread with
    its own core and this much memory.
    """

    scheduler: Literal["slurm"]
    jobs: Annotated[int, Field(ge=1, le=100_000)]
    workers_per_job: Annotated[int, Field(ge=1, le=1024)] = 1
    memory_per_worker_MB: Annotated[int, Field(ge=500, le=1_000_000)] = 2000
    # The forms of time that sbatch takes: minutes, MM:SS, HH:MM:SS, D-HH, D-HH:MM, D-HH:MM:SS.
    time: Annotated[str, Field(pattern=r"^(\d+|\d+:\d\d|\d+:\d\d:\d\d|\d+-\d+(:\d\d){0,2})$")]
    partition: Word | None = None
    account: Word | None = None
    setup: Annotated[tuple[Line, ...], Field(strict=False)] = ()
    options: Annotated[
        tuple[Annotated[str, Field(pattern=r"^--[^\n]+$")], ...], Field(strict=False)
    ] = ()
    # Workers run in this environment unless the file names another one.
    python: Line = sys.executable
    interface: Word | None = None


def read_cluster_file(path: Path) -> JobArray:
    """Read a cluster file. Raises BadInput with file, line and key."""
    file = read_toml(path, ClusterFile)
    return file.to_dataclass(JobArray)
