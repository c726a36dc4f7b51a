"""rfca-rig fit"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json
from rfca_rig.cli.reporting import Shaft

if TYPE_CHECKING:
    from rfca_rig.analysis.fitting.result import FitResult


def fit(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Campaign folders, imported or run folders, or .h5 files.")],
    parameters: Annotated[
        str, typer.Option("--parameters", metavar="NAME,...", help="What to fit; all that the section known_to lists if not given.")
    ] = "",
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write the fitted model to this .toml file.")] = None,
    shaft: Annotated[
        Shaft, typer.Option("--shaft", help="Simulate along the recorded turn, at the average measured speed, or as commanded.")
    ] = Shaft.recorded,
    phases: Annotated[
        str, typer.Option("--phases", metavar="NAME,...", help="Phases to fit: free, touchdown, loading, release, rebound.")
    ] = "loading",
    after_touchdown: Annotated[
        float, typer.Option("--after-touchdown", metavar="MS", min=0, max=5000, help="How many ms of the first contact to leave out.")
    ] = 200.0,
    starts: Annotated[int, typer.Option("--starts", min=1, max=64, help="Begin from this many places, and tell how many agree.")] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the places to begin from.")] = 0,
    as_json: Json = False,
) -> None:
    """Fit what the model believes of the rig to recordings: values, standard errors, and what the recordings cannot tell apart.

    By default from 200 ms after touchdown to the valley, where the model meets a leg that lacks nothing to the noise.

    Example: rfca-rig fit runs/SIM-table-ii-001 --parameters k0,friction --out model.toml
    """
    import numpy as np

    from rfca_rig.analysis.fitting.fit import Search
    from rfca_rig.analysis.fitting.model_file import write_model_file
    from rfca_rig.analysis.fitting.residuals import Window
    from rfca_rig.analysis.fitting.strokes import Comparison, fit_recordings
    from rfca_rig.campaign.opening import open_with_belief

    comparison = Comparison(shaft.value, Window(tuple(_names(phases)), 1e-3 * after_touchdown))
    recordings = open_with_belief(paths)
    with _progress(quiet=as_json) as progress:
        search = Search(starts=starts, rng=np.random.default_rng(seed), progress=progress)
        result = fit_recordings(recordings, _names(parameters), comparison, search)
    if out is not None:
        sources = [f"{path} ({recording.source}): {recording.title}" for path, recording in zip(paths, recordings, strict=True)]
        write_model_file(out, result, recordings[0].believed, recordings[0].known_to, sources)
    _print(result, out, as_json)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _print(result: "FitResult", out: Path | None, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(result.plain(), indent=1))
        return
    for line in result.lines():
        typer.echo(line)
    if out is not None:
        typer.echo(f"{out}: the fitted model", err=True)


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[int, float], None]]:
    """A line on the error stream that counts; only where a person watches."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, quiet=quiet, highlight=False)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, transient=True) as bar:
        task = bar.add_task("fitting", total=None)
        yield lambda simulated, chi2: bar.update(task, description=f"fitting: {simulated} sets of values, chi2 {chi2:.0f}")
