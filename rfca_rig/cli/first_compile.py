"""Notice that the model is being compiled, once on a machine, when it is first used."""

from pathlib import Path

import typer

from rfca_rig.cli.progress import Bars
from rfca_rig.cli.terminal import Say
from rfca_rig.model.compiled import CACHE_FOLDER, is_warm

SAID = "compiling the model, once on this machine, ten seconds to a minute ..."


def tell_first_compile(bars: Bars, quiet: bool, say: Say = lambda line: typer.echo(line, err=True)) -> None:
    """To be called before the first computation of a command; prints nothing where the model is compiled already."""
    if not is_warm() and not quiet:
        say(SAID)
        bars.going_on("compiling", _so_far)


def _so_far() -> str:
    return f"{sum(1 for _ in Path(CACHE_FOLDER).rglob('*.nbi'))} functions"
