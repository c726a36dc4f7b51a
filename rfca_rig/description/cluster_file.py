"""A cluster file: resources to request from SLURM for workers, and the commands that a worker needs before it starts."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rfca_rig.executors.slurm import JobArray
from rfca_rig.toml import Section, read_toml

# These values go into a batch script: no blanks, separators or line breaks may change its meaning.
Word = Annotated[str, Field(pattern=r"^[^\s,;]+$")]
Line = Annotated[str, Field(pattern=r"^[^\n]+$")]


class ClusterFile(Section):
    """`jobs` jobs of `workers_per_job` workers each. A worker is a process of one thread with its own core and this much memory."""

    scheduler: Literal["slurm"]
    jobs: Annotated[int, Field(ge=1, le=100_000)]
    workers_per_job: Annotated[int, Field(ge=1, le=1024)] = 1
    memory_per_worker_MB: Annotated[int, Field(ge=500, le=1_000_000)] = 2000
    # The forms of time that sbatch takes: minutes, MM:SS, HH:MM:SS, D-HH, D-HH:MM, D-HH:MM:SS.
    time: Annotated[str, Field(pattern=r"^(\d+|\d+:\d\d|\d+:\d\d:\d\d|\d+-\d+(:\d\d){0,2})$")]
    partition: Word | None = None
    account: Word | None = None
    setup: Annotated[tuple[Line, ...], Field(strict=False)] = ()
    options: Annotated[tuple[Annotated[str, Field(pattern=r"^--[^\n]+$")], ...], Field(strict=False)] = ()
    # Workers run in this environment unless the file names another one.
    python: Line = sys.executable
    interface: Word | None = None


def read_cluster_file(path: Path) -> JobArray:
    """Read a cluster file. Raises BadInput with file, line and key."""
    file = read_toml(path, ClusterFile)
    return JobArray(
        jobs=file.jobs,
        workers_per_job=file.workers_per_job,
        memory_per_worker_MB=file.memory_per_worker_MB,
        time=file.time,
        partition=file.partition,
        account=file.account,
        setup=file.setup,
        options=file.options,
        python=file.python,
        interface=file.interface,
    )
