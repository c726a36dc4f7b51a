"""Who does the work of a command that consists of many simulations: options, and the executor they ask for."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.progress import Told

if TYPE_CHECKING:
    from rfca_rig.executors.base import TaskExecutor
    from rfca_rig.executors.environment import Facts

Workers = Annotated[
    int | None, typer.Option("--workers", metavar="N", min=1, max=1024, help="Processes of one thread each; one per core if not given.")
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", metavar="WHERE", help="Have it done by tcp://HOST:PORT, a Dask scheduler, or slurm:FILE, a file for SLURM."),
]

SLURM, ADDRESSES = "slurm:", ("tcp://", "tls://")


@contextmanager
def open_executor(workers: int | None, cluster: str | None, told: Told, results: Path | None = None) -> "Iterator[TaskExecutor]":
    """The executor that `--workers` and `--cluster` ask for; `results` is where the work leaves files, None where it leaves none.

    Raises BadInput where there is no such executor, or workers are not as this process.
    """
    from rfca_rig.errors import BadInput
    from rfca_rig.executors.cores import machine_cores
    from rfca_rig.executors.local import process_executor

    if cluster is not None and workers is not None:
        raise BadInput("--workers counts processes of this computer; how many --cluster has is decided where they are started")
    if cluster is None:
        with process_executor(workers or machine_cores()) as here:
            yield here
    elif cluster.startswith(SLURM):
        with _hired(Path(cluster.removeprefix(SLURM)), told, results) as there:
            yield there
    elif cluster.startswith(ADDRESSES):
        with _connected(cluster, told, results) as there:
            yield there
    else:
        raise BadInput(f"--cluster {cluster}: should be tcp://HOST:PORT or slurm:FILE")


def _hired(file: Path, told: Told, results: Path | None) -> "AbstractContextManager[TaskExecutor]":
    from rfca_rig.description.cluster_file import read_cluster_file
    from rfca_rig.executors.slurm import slurm_workers

    seen = _seen_by_all(results)
    return slurm_workers(read_cluster_file(file), seen or Path(), seen, facts, told, _notice)


def _connected(address: str, told: Told, results: Path | None) -> "AbstractContextManager[TaskExecutor]":
    from rfca_rig.executors.cluster import connected

    return connected(address, _seen_by_all(results), facts, told, _notice)


def _seen_by_all(results: Path | None) -> Path | None:
    """A folder that is there already and on the disk of the results: theirs may still have to be made."""
    return None if results is None else next(folder for folder in results.resolve().parents if folder.is_dir())


def _notice(line: str) -> None:
    typer.echo(line, err=True)


def facts() -> "Facts":
    """What workers must have in common with this process: the effects of a lab among it."""
    from rfca_rig.executors.environment import facts_here, source_hash
    from rfca_rig.model.catalogue import FOLDER_VARIABLE

    own = os.environ.get(FOLDER_VARIABLE)
    return {**facts_here(), "own effects": source_hash(Path(own)) if own else "none"}
