"""Options that several commands share, and the checks of their values before the work; and the
executor that --workers and --cluster select.

The help is plain: commands in groups by the work they are for, each summary whole, no types of
Python. Rich would do the groups, at two fifths more time of every --help.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from rfca_rig.cli.terminal import echo
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressReport
from rfca_rig.recording.atomic import refuse_devices

if TYPE_CHECKING:
    from rfca_rig.executors.environment import Facts
    from rfca_rig.executors.mapping import TaskExecutor


Rig = Annotated[
    str,
    typer.Option(
        "--rig",
        metavar="NAME|FILE",
        help="The rig: a name in calibration/ (plan --list), or a .toml file.",
    ),
]
Protocol = Annotated[
    str,
    typer.Option(
        "--protocol",
        metavar="NAME|FILE",
        help="The protocol: a name in protocols/ (plan --list), or a .toml file.",
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="N",
        min=0,
        help="Seed of the twin's noise; the rig file's own if not given.",
    ),
]
Model = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="A model file, as fit --out writes it, in place of the nominal model.",
    ),
]
Operator = Annotated[
    str,
    typer.Option(
        "--operator", metavar="NAME", help="Who runs the rig; the login name if not given."
    ),
]
Sample = Annotated[
    str,
    typer.Option(
        "--sample", metavar="NAME", help="Which specimen is on the rig, as it is labelled."
    ),
]
Fault = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="NAME@SECONDS",
        help=(
            "Let a twin's device fail then, or NAME@FROM-TO; may be repeated. twin serve "
            "--list prints the names."
        ),
    ),
]
Json = Annotated[
    bool,
    typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output."),
]
AsIs = Annotated[
    bool,
    typer.Option(
        "--as-is", help="Take values of a campaign that are probably in another unit, too."
    ),
]
AllowOutside = Annotated[
    bool,
    typer.Option(
        "--allow-outside",
        help=(
            "Read files outside a folder of recordings, too, to which its links or its model lead."
        ),
    ),
]
Pdf = Annotated[
    bool,
    typer.Option(
        "--pdf",
        help="Print the pages as PDF too, with the Chromium, Chrome or Edge of this machine.",
    ),
]
Figures = Annotated[
    bool,
    typer.Option(
        "--figures",
        help="Write every figure of the pages as SVG too, into the folder figures beside them.",
    ),
]
Dry = Annotated[bool, typer.Option("--dry-run", help="Print and check the plan, move nothing.")]
View = Annotated[
    bool,
    typer.Option(
        "--view",
        help="Watch the run in the browser, pause and stop it from there; the address is printed.",
    ),
]
ViewPort = Annotated[
    int | None,
    typer.Option(
        "--view-port",
        metavar="PORT",
        min=0,
        max=65535,
        help="The port of --view; any free one if not given.",
    ),
]
Pace = Annotated[
    float,
    typer.Option(
        "--pace",
        metavar="X",
        min=0.0,
        help="With --view, a twin runs at X times real time at most; 0 is full speed.",
    ),
]

# Every command stands in one group; the order is that of the help.
GROUPS = {
    "Measure": ("plan", "dynamic", "static", "paper", "fatigue", "resume", "record"),
    "Look": ("runs", "view", "trip"),
    "Understand": ("report", "fit", "diagnose", "reference", "crosscheck", "prove"),
    "Design": ("predict", "strip", "sweep"),
    "Set up": ("doctor", "setup", "calibrate", "contract", "twin"),
    "Files": ("init", "import", "export", "datasets", "check", "recover", "schema"),
}


def out_folder(folder: Path | None) -> Path | None:
    """The folder unchanged, if it exists and is writable, or can be made. Raises BadInput."""
    if folder is None:
        return None
    # A folder that does not exist yet is made below its nearest existing parent, which must be
    # writable.
    nearest = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not nearest.is_dir():
        obstacle = "is"
        if nearest != folder:
            obstacle = f"{nearest} is"
        raise BadInput(f"{folder}: {obstacle} a file, where a folder is needed; name another")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise BadInput(
            f"{folder}: nothing may be written into {nearest}; name another folder, or "
            "make that one yours"
        )
    return folder


def out_file(file: Path | None) -> Path | None:
    """The file unchanged, if it can be written. Raises BadInput."""
    if file is None:
        return None
    if file.is_dir():
        raise BadInput(f"{file}: is a folder, where a file is needed; name a file in it")
    refuse_devices(file)
    if not file.parent.is_dir():
        raise BadInput(f"{file}: there is no folder {file.parent}; make it, or name another file")
    target = file
    if not file.exists():
        target = file.parent
    if not os.access(target, os.W_OK):
        raise BadInput(f"{file}: may not be written; name another file, or make that one yours")
    return file


Runs = Annotated[
    Path,
    typer.Option(
        "--runs",
        metavar="DIR",
        callback=out_folder,
        help="Folder that receives the new run folder.",
    ),
]


class PageCopies:
    """What is made of written pages: PDFs, and their figures as files. Raises BadInput at once
    where PDFs are wanted and no browser is found.
    """

    def __init__(self, pdf: bool, figures: bool = False) -> None:
        from rfca_rig.reports.pdf import find_browser

        self._browser = find_browser() if pdf else None
        self._has_figures = figures

    def make(self, pages: Iterable[Path], quiet: bool) -> None:
        """Makes the copies that are wanted."""
        from rfca_rig.reports.page_figures import FOLDER, write_page_figures
        from rfca_rig.reports.pdf import print_pdfs

        listed = list(pages)
        if self._has_figures:
            written = write_page_figures(listed)
            if not quiet:
                echo(f"{listed[0].parent / FOLDER}: {len(written)} figures as SVG", err=True)
        if self._browser is None:
            return
        for printed in print_pdfs(self._browser, listed):
            if not quiet:
                echo(f"{printed}: the same page, printed", err=True)


class Command(TyperCommand):
    """A command whose arguments are named by their metavar alone."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        # Braces around a required argument are in no other program's usage line.
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        for title, kind in (("Arguments", "argument"), ("Options", "option")):
            records = [
                parameter.get_help_record(ctx)
                for parameter in self.get_params(ctx)
                if parameter.param_type_name == kind
            ]
            # Behind an argument's name stands its type, as in "RUN <path>".
            rows = [(name.partition(" <")[0], text) for name, text in filter(None, records)]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


class CommandGroup(TyperGroup):
    """A group whose help shows the whole summary of each command, where plain help would cut it
    after half a line.
    """

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        self._write_section(formatter, "Commands", self.commands)

    def _write_section(self, formatter: Any, title: str, names: Any) -> None:
        with formatter.section(title):
            formatter.write_dl(
                [(name, self.commands[name].get_short_help_str(limit=1000)) for name in names]
            )


class ProgramGroup(CommandGroup):
    """The program itself, with its commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        for title, names in GROUPS.items():
            self._write_section(formatter, title, names)


Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=1024,
        help="Processes of one thread each; one per core if not given.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="WHERE",
        help="Have it done by tcp://HOST:PORT, a Dask scheduler, or slurm:FILE, a file for SLURM.",
    ),
]

SLURM = "slurm:"
ADDRESSES = ("tcp://", "tls://")


@contextmanager
def open_executor(
    workers: int | None,
    cluster: str | None,
    report_progress: ProgressReport,
    results: Path | None = None,
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
    from rfca_rig.executors.mapping import process_executor
    from rfca_rig.executors.termination import interrupt_on_termination

    if cluster is not None and workers is not None:
        raise BadInput(
            "--workers counts processes of this computer; how many --cluster has is "
            "decided where they are started"
        )
    if cluster is None:
        with (
            interrupt_on_termination(),
            process_executor(workers or machine_cores()) as local_executor,
        ):
            yield local_executor
    elif cluster.startswith(SLURM):
        from rfca_rig.executors.slurm import read_cluster_file, slurm_workers

        shared = _find_shared_folder(results)
        with slurm_workers(
            read_cluster_file(Path(cluster.removeprefix(SLURM))),
            shared or Path(),
            shared,
            collect_facts,
            report_progress,
            _notice,
        ) as cluster_executor:
            yield cluster_executor
    elif cluster.startswith(ADDRESSES):
        from rfca_rig.executors.cluster import connect_to_scheduler

        with connect_to_scheduler(
            cluster, _find_shared_folder(results), collect_facts, report_progress, _notice
        ) as cluster_executor:
            yield cluster_executor
    else:
        raise BadInput(f"--cluster {cluster}: should be tcp://HOST:PORT or slurm:FILE")


def _find_shared_folder(results: Path | None) -> Path | None:
    """An existing folder on the disk of the results: the results' own may still have to be made."""
    if results is None:
        return None
    return next(folder for folder in results.resolve().parents if folder.is_dir())


def _notice(line: str) -> None:
    echo(line, err=True)


def collect_facts() -> "Facts":
    """Facts that workers must share with this process, a lab's own effects among them."""
    from rfca_rig.executors.environment import collect_facts, hash_source
    from rfca_rig.model.catalogue import FOLDER_VARIABLE

    folder = os.environ.get(FOLDER_VARIABLE)
    own_effects = "none"
    if folder:
        own_effects = hash_source(Path(folder))
    return {**collect_facts(), "own effects": own_effects}
