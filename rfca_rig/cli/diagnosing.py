"""rfca-rig diagnose"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json


def diagnose(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Campaign folders, imported or run folders, or .h5 files.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for diagnosis.html, diagnosis.json and model.toml.")] = Path(
        "diagnosis"
    ),
    as_json: Json = False,
) -> None:
    """Say where model and recordings part, which physics was left out, and how sure that is.

    Example: rfca-rig diagnose runs/SIM-table-ii-001 --out diagnosis
    """
    from rfca_rig.campaign.opening import open_with_belief
    from rfca_rig.diagnosis.diagnose import diagnose as diagnosed
    from rfca_rig.diagnosis.model_after import write_model_after
    from rfca_rig.report.diagnosis_files import terminal_lines, write_diagnosis

    recordings = open_with_belief(paths)
    with _progress(quiet=as_json) as progress:
        diagnosis = diagnosed(recordings, progress)
    out.mkdir(parents=True, exist_ok=True)
    write_diagnosis(diagnosis, out)
    write_model_after(out / "model.toml", diagnosis, recordings[0])
    if as_json:
        typer.echo((out / "diagnosis.json").read_text(encoding="utf-8"), nl=False)
        return
    for line in terminal_lines(diagnosis):
        typer.echo(line)
    typer.echo(f"{out / 'diagnosis.html'}: the whole answer", err=True)


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """A bar on the error stream; only where a person watches."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, quiet=quiet, highlight=False)
    columns = (TextColumn("{task.description:<40}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, transient=True) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda text, share: bar.update(task, description=text, completed=share)
