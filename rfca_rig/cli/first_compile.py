"""Notice that the model is being compiled, once on a machine, when it is first used."""

from pathlib import Path

import typer

from rfca_rig.cli.progress import ProgressLines
from rfca_rig.cli.terminal import Say
from rfca_rig.model.compiled import CACHE_FOLDER, is_warm

COMPILE_NOTICE = "compiling the model, once on this machine, ten seconds to a minute ..."


def announce_first_compile(bars: ProgressLines, quiet: bool, say: Say = lambda line: typer.echo(line, err=True)) -> None:
    """To be called before the first computation of a command; prints nothing where the model is compiled already."""
    if not is_warm() and not quiet:
        say(COMPILE_NOTICE)
        bars.show_unbounded("compiling", _so_far)


def _so_far() -> str:
    return f"{sum(1 for _ in Path(CACHE_FOLDER).rglob('*.nbi'))} functions"
