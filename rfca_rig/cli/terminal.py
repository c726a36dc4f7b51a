"""Terminal output of a run: every line marked SIM or REAL, a progress bar on a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from rfca_rig.suggestions import printable

Say = Callable[[str], None]


class ErrorConsole(Console):
    """A console whose reader may leave: it is silent from then on, where rich would end the process."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


@contextmanager
def progress_bar(mark: str, total_s: float, quiet: bool) -> Iterator[tuple[Callable[[str, float], None], Say]]:
    """Yields (advance, say): `advance(label, rig_s)` moves the bar by seconds of rig time, `say` prints a line above it.

    The bar shows only on a terminal; `quiet` silences both.
    """
    console = ErrorConsole(file=sys.stderr, quiet=quiet, highlight=False)
    columns = (
        TextColumn(mark),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, transient=True) as progress:
        task = progress.add_task("", total=total_s)

        def advance(label: str, rig_s: float) -> None:
            progress.update(task, advance=rig_s, description=label)

        def say(line: str) -> None:
            _print(progress.console, mark, line)

        yield advance, say


def make_marked_say(mark: str, quiet: bool) -> Say:
    """A function that prints lines with the mark in front, on the error stream, because --json owns the output."""
    console = ErrorConsole(file=sys.stderr, quiet=quiet, highlight=False)
    return lambda line: _print(console, mark, line)


def _print(console: Console, mark: str, line: str) -> None:
    """A closed terminal must not keep a motor from stopping, nor a recording from being completed."""
    with suppress(OSError):
        # No markup: rich would take bracketed words of a message, for example [limits], for styles.
        console.print(f"{mark} {printable(line)}", markup=False, soft_wrap=True)
