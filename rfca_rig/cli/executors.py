"""Options for commands that consist of many simulations, and the executor that they select."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.progress import ProgressReport

if TYPE_CHECKING:
    from rfca_rig.executors.environment import Facts
    from rfca_rig.executors.mapping import TaskExecutor

Workers = Annotated[
    int | None, typer.Option("--workers", metavar="N", min=1, max=1024, help="Processes of one thread each; one per core if not given.")
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", metavar="WHERE", help="Have it done by tcp://HOST:PORT, a Dask scheduler, or slurm:FILE, a file for SLURM."),
]

SLURM, ADDRESSES = "slurm:", ("tcp://", "tls://")


@contextmanager
def open_executor(
    workers: int | None, cluster: str | None, report_progress: ProgressReport, results: Path | None = None
) -> "Iterator[TaskExecutor]":
    """The executor that `--workers` and `--cluster` ask for.

    Parameters
    ----------
    workers : int or None
        Processes of this computer; None for one per core.
    cluster : str or None
        Address of a Dask scheduler, or slurm:FILE.
    report_progress : callable
        Called with the progress.
    results : Path, optional
        Where the work leaves files; None where it leaves none.

    Raises
    ------
    BadInput
        There is no such executor, or its workers differ from this process.
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
        from rfca_rig.description.cluster_file import read_cluster_file
        from rfca_rig.executors.slurm import slurm_workers

        shared = _find_shared_folder(results)
        with slurm_workers(
            read_cluster_file(Path(cluster.removeprefix(SLURM))), shared or Path(), shared, collect_facts, report_progress, _notice
        ) as there:
            yield there
    elif cluster.startswith(ADDRESSES):
        from rfca_rig.executors.cluster import connect_to_scheduler

        with connect_to_scheduler(cluster, _find_shared_folder(results), collect_facts, report_progress, _notice) as there:
            yield there
    else:
        raise BadInput(f"--cluster {cluster}: should be tcp://HOST:PORT or slurm:FILE")


def _find_shared_folder(results: Path | None) -> Path | None:
    """An existing folder on the disk of the results: the results' own may still have to be made."""
    return None if results is None else next(folder for folder in results.resolve().parents if folder.is_dir())


def _notice(line: str) -> None:
    typer.echo(line, err=True)


def collect_facts() -> "Facts":
    """Facts that workers must share with this process, a lab's own effects among them."""
    from rfca_rig.executors.environment import collect_facts, hash_source
    from rfca_rig.model.catalogue import FOLDER_VARIABLE

    own = os.environ.get(FOLDER_VARIABLE)
    return {**collect_facts(), "own effects": hash_source(Path(own)) if own else "none"}
