"""Workers as a job array of SLURM, of a scheduler that lives in this process and goes with it.

Workers that lose their scheduler, because this process was killed, end by themselves within DEATH_TIMEOUT_S.
"""

import os
import resource
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import rmtree, which
from tempfile import mkdtemp
from threading import current_thread, main_thread
from typing import Any

from rfca_rig.errors import BadInput, RigError
from rfca_rig.executors.cluster import DaskExecutor, WorkerStartup, workers_of
from rfca_rig.executors.cores import ONE_THREAD
from rfca_rig.executors.environment import Facts
from rfca_rig.executors.optional import distributed
from rfca_rig.progress import Told

DEATH_TIMEOUT_S = 60
BESIDE_WORKERS_MB = 500  # what the process that watches over the workers of a job takes
SCRIPT, KEYS = "workers.sbatch", "keys.pem"


@dataclass(frozen=True)
class JobArray:
    """`jobs` like ones, each of so many workers of one thread, a core and `memory_per_worker_MB` for each of them.

    `time` as sbatch has it; `setup` are lines of the shell before the workers are started, `options` further ones of sbatch's, as
    --qos=long; `interface` names the network over which workers reach this computer, where it has several.
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
        """In all jobs."""
        return self.jobs * self.workers_per_job

    def script(self, address: str, folder: Path) -> str:
        """What sbatch is given; `folder` holds the keys and receives what the jobs print."""
        asked = {
            "job-name": "rfca-rig",
            "array": f"0-{self.jobs - 1}",
            "ntasks": "1",
            "cpus-per-task": f"{self.workers_per_job}",
            "mem": f"{self.workers_per_job * self.memory_per_worker_MB + BESIDE_WORKERS_MB}M",
            "time": self.time,
            "partition": self.partition,
            "account": self.account,
            "output": f"{folder}/%A_%a.log",
        }
        options = [f"--{name}={value}" for name, value in asked.items() if value is not None]
        lines = [
            "#!/bin/bash",
            *(f"#SBATCH {option}" for option in (*options, *self.options)),
            *(f"export {name}={value}" for name, value in ONE_THREAD.items()),
            'export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-${SLURM_TMPDIR:-${TMPDIR:-/tmp}}/rfca-rig-$(id -u)}"',  # a node's own disk
            *self.setup,
            shlex.join(self._worker(address, folder / KEYS)),
        ]
        return "\n".join(lines) + "\n"

    def _worker(self, address: str, keys: Path) -> list[str]:
        return [
            *("exec", self.python, "-m", "distributed.cli.dask_worker", address),
            *("--nworkers", f"{self.workers_per_job}", "--nthreads", "1", "--memory-limit", f"{self.memory_per_worker_MB}MB"),
            *("--death-timeout", f"{DEATH_TIMEOUT_S}", "--no-dashboard", "--local-directory", "/tmp"),
            *(f"--tls-{part}={keys}" for part in ("ca-file", "cert", "key")),
        ]


@contextmanager
def slurm_workers(
    array: JobArray, shared: Path, folder: Path | None, facts: Callable[[], Facts], told: Told, notice: Callable[[str], None]
) -> Iterator[DaskExecutor]:
    """The workers of a job array, which is cancelled when the block ends, however it ends.

    Its script, its keys and what its jobs print stand in a new folder in `shared`, which is left where the block ends with an error.
    """
    distributed()
    if which("sbatch") is None:
        raise BadInput("--cluster slurm:FILE: there is no sbatch on this computer; type this where jobs are submitted")
    own = Path(mkdtemp(prefix="rfca-rig-jobs-", dir=shared)).resolve()
    with _scheduler(array.interface, own / KEYS) as scheduler:
        (own / SCRIPT).write_text(array.script(scheduler.scheduler_address, own), encoding="utf-8")
        with (
            _ended_in_order(),
            _submitted(own / SCRIPT) as job,
            workers_of(scheduler, folder, facts, WorkerStartup(array.workers, told, partial(_there_may_be_some, job, own))) as executor,
        ):
            notice(f"SLURM has job {job}, {array.jobs} times {array.workers_per_job} workers")
            executor.wait_for_first()
            executor.check(notice)
            yield executor
    rmtree(own)


@contextmanager
def _ended_in_order() -> Iterator[None]:
    """A closed terminal, and whoever asks this process to end, are answered as ^C is: jobs would outlive it."""
    if current_thread() is not main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.default_int_handler) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _scheduler(interface: str | None, keys: Path) -> Iterator[Any]:
    """A scheduler in this process, with keys of its own: who is not given them can neither hand out work nor see it."""
    _allow_many_connections()
    security = distributed().Security.temporary()
    keys.touch(mode=0o600)
    keys.write_text(f"{security.tls_client_key}{security.tls_client_cert}", encoding="utf-8")
    try:
        cluster = distributed().LocalCluster(
            n_workers=0,
            processes=True,
            host=None if interface else _own_address(),
            interface=interface,
            protocol="tls://",
            security=security,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"allowed_failures": 0},
        )
    except (OSError, ValueError, RuntimeError) as error:
        raise BadInput(f"the scheduler for the workers cannot listen{f' on {interface}' if interface else ''}: {error}") from None
    with cluster:
        yield cluster


def _allow_many_connections() -> None:
    """Each worker takes some; what is usual for a process is too few for a thousand workers."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _own_address() -> str:
    return str(distributed().utils.get_ip())


@contextmanager
def _submitted(script: Path) -> Iterator[str]:
    """The number of the array's job."""
    said = _asked("sbatch", "--parsable", str(script))
    if said.returncode:
        raise BadInput(f"sbatch refused {script}: {_first_line(said.stderr)}")
    job = said.stdout.strip().split(";")[0]
    try:
        yield job
    finally:
        _asked("scancel", job)


def _there_may_be_some(job: str, folder: Path) -> None:
    """Raises RigError where all jobs of the array have ended."""
    said = _asked("squeue", "--noheader", "--format=%i", f"--jobs={job}")
    is_forgotten = "Invalid job id" in said.stderr
    if is_forgotten or (said.returncode == 0 and not said.stdout.strip()):
        raise RigError(f"all jobs of SLURM's job {job} have ended, {_last_words(folder)}; the same command goes on where it stood")


def _last_words(folder: Path) -> str:
    """What a job printed last that says why, and where the rest stands."""
    lines = [line for log in sorted(folder.glob("*.log")) for line in log.read_text(encoding="utf-8", errors="replace").splitlines()]
    told = [line for line in lines if "rror" in line] or lines
    return f"as {told[-1].strip()!r} in {folder}" if told else f"without a word in {folder}"


def _asked(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(words, capture_output=True, text=True, check=False, env=_environment())


def _environment() -> dict[str, str]:
    """Without what SLURM tells the job that this command itself may run in: its workers are jobs of their own."""
    return {name: value for name, value in os.environ.items() if not name.startswith("SLURM_") or name == "SLURM_CONF"}


def _first_line(text: str) -> str:
    return next((line.strip() for line in text.splitlines() if line.strip()), "it gave no reason")
