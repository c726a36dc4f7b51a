"""rfca-rig diagnose"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, Rig, Runs, Seed

if TYPE_CHECKING:
    from rfca_rig.diagnosis.result import Diagnosis
    from rfca_rig.protocol.plan import Limits
    from rfca_rig.recording.form import Recording


def diagnose(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Campaign folders, imported or run folders, or .h5 files.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for diagnosis.html, .json, model.toml, next-experiment.toml.")
    ] = Path("diagnosis"),
    close_the_loop: Annotated[
        bool, typer.Option("--close-the-loop", help="Run the proposed experiment on --rig and diagnose again, until nothing is open.")
    ] = False,
    rig: Rig = "twin",
    rounds: Annotated[int, typer.Option("--rounds", min=1, help="How many experiments --close-the-loop may run.")] = 3,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    as_json: Json = False,
) -> None:
    """Say where model and recordings part, which physics was left out, and how sure that is.

    Example: rfca-rig diagnose runs/SIM-table-ii-001 --out diagnosis
    """
    from rfca_rig.campaign.opening import open_with_belief
    from rfca_rig.report.diagnosis_files import terminal_lines

    if len(paths) == 1 and (paths[0] / "pendulum.toml").is_file():
        diagnosis = _pendulum(paths[0], out, as_json)
    elif not close_the_loop:
        diagnosis = _diagnosed(open_with_belief(paths), out, as_json, None)
    else:
        from rfca_rig.cli.closing_the_loop import Loop
        from rfca_rig.cli.closing_the_loop import close_the_loop as closed
        from rfca_rig.cli.places import find_file
        from rfca_rig.description.rig_file import read_rig

        loop = Loop(find_file("calibration", rig), rounds, runs, out, seed, quiet=as_json)
        limits, recordings = read_rig(loop.rig_path).facts().limits, open_with_belief(paths)
        diagnosis = _diagnosed(recordings, out, as_json, limits)
        diagnosis = closed(loop, recordings, diagnosis, lambda all_of_them: _diagnosed(all_of_them, out, as_json, limits))
    if as_json:
        typer.echo((out / "diagnosis.json").read_text(encoding="utf-8"), nl=False)
        return
    for line in terminal_lines(diagnosis):
        typer.echo(line)
    typer.echo(f"{out / 'diagnosis.html'}: the whole answer", err=True)


def _pendulum(folder: Path, out: Path, quiet: bool) -> "Diagnosis":
    """The diagnosis of a driven pendulum without ground; a model file of a leg does not fit it."""
    from rfca_rig.campaign.pendulum import read_pendulum_campaign
    from rfca_rig.diagnosis.pendulum import diagnose_pendulum
    from rfca_rig.report.diagnosis_files import write_diagnosis

    with _progress(quiet) as progress:
        diagnosis = diagnose_pendulum(read_pendulum_campaign(folder), progress)
    out.mkdir(parents=True, exist_ok=True)
    write_diagnosis(diagnosis, out)
    return diagnosis


def _diagnosed(recordings: "Sequence[Recording]", out: Path, quiet: bool, limits: "Limits | None") -> "Diagnosis":
    """The diagnosis, with all its files in `out`."""
    from rfca_rig.diagnosis.diagnose import diagnose as diagnosed
    from rfca_rig.diagnosis.model_after import write_model_after
    from rfca_rig.diagnosis.next_protocol import write_next_protocol
    from rfca_rig.report.diagnosis_files import write_diagnosis

    with _progress(quiet) as progress:
        diagnosis = diagnosed(recordings, progress, limits)
    out.mkdir(parents=True, exist_ok=True)
    write_diagnosis(diagnosis, out)
    write_model_after(out / "model.toml", diagnosis, recordings[0])
    write_next_protocol(out, diagnosis.next_experiment)
    return diagnosis


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
