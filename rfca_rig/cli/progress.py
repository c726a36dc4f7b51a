"""Progress of work that takes more than a moment, on the error stream: a line that moves on a
terminal; in a file or a pipe, a new line at intervals.

Silent where a command prints JSON. The remaining time is estimated from all work so far. Where the
amount of work is unknown, the line shows the elapsed time instead.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from threading import Event, Thread
from typing import IO, TYPE_CHECKING, cast

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from rfca_rig.cli.terminal import Say, echo
from rfca_rig.escaping import printable
from rfca_rig.executors.cores import machine_cores
from rfca_rig.progress import ProgressCount
from rfca_rig.subprocesses import python_command

if TYPE_CHECKING:
    from rfca_rig.model.parameters import RigModel

# Parts differ in length, so the remaining time is estimated from all of them and not from the last
# half minute.
LONG_S = 1e4
BAR_WIDTH = 20
WIDEST = 34
# Interval in s of the lines in a log: whoever follows it takes half a minute of silence for a
# hang, and the thread that prints may be late by some seconds on a busy machine.
LOG_EVERY_S = 25.0
# For the thread that prints them; a line takes far less than a millisecond.
ENDED_WITHIN_S = 1.0

COMPILE_AHEAD = """
import os, pickle, sys
from rfca_rig.model.stroke import compile_side_by_side
os.nice(10)
compile_side_by_side(pickle.load(sys.stdin.buffer))
"""
COMPILE_NOTICE = "compiling the model, once on this machine, ten seconds to a minute ..."


class ErrorConsole(Console):
    """A console whose reader may leave: it is silent from then on, where rich would end the
    process.
    """

    def on_broken_pipe(self) -> None:
        self.quiet = True


@contextmanager
def progress_bar(
    mark: str, total_s: float, quiet: bool
) -> Iterator[tuple[Callable[[str, float], None], Say]]:
    """Yields (advance, say): `advance(label, rig_s)` moves the bar by seconds of rig time, `say`
    prints a line above it.

    Without a terminal a line is printed at intervals instead of the bar; `quiet` silences both.
    """
    console = ErrorConsole(file=sys.stderr, quiet=quiet, highlight=False)
    columns = (
        TextColumn(mark),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    bars = Progress(
        *columns, console=console, disable=quiet or not console.is_terminal, transient=True
    )
    with bars as progress, _log_at_intervals(bars, console, mark):
        task = progress.add_task("", total=1.0)

        def advance(label: str, rig_s: float) -> None:
            # A plan of no duration has no share to show.
            share = rig_s / total_s if total_s else 0.0
            progress.update(task, advance=share, description=label)

        def say(line: str) -> None:
            _print(progress.console, mark, line)

        yield advance, say


def make_marked_say(mark: str, quiet: bool) -> Say:
    """A function that prints lines with the mark in front, on the error stream, because --json
    owns the output.
    """
    console = ErrorConsole(file=sys.stderr, quiet=quiet, highlight=False)
    return lambda line: _print(console, mark, line)


def _print(console: Console, mark: str, line: str) -> None:
    """A closed terminal must not keep a motor from stopping, nor a recording from being
    completed.
    """
    if mark:
        line = f"{mark} {line}"
    with suppress(OSError):
        # No markup: rich would take bracketed words of a message, for example [limits], for styles.
        console.print(printable(line), markup=False, soft_wrap=True)


@contextmanager
def _log_at_intervals(bars: Progress, console: Console, mark: str = "") -> Iterator[None]:
    """Within the block, a thread prints where the work is, for readers without a terminal."""
    if console.quiet or console.is_terminal:
        yield
        return
    ended = Event()
    log = ProgressLog(bars)
    printing = Thread(
        target=print_at_intervals,
        args=(log.describe, lambda line: _print(console, mark, line), ended.wait),
        daemon=True,
    )
    # Where the system allows no further thread, the work matters more than lines about it.
    with suppress(RuntimeError):
        printing.start()
    try:
        yield
    finally:
        ended.set()
        if printing.ident:
            # A reader of the log that takes nothing must not keep the command from ending.
            printing.join(ENDED_WITHIN_S)


def print_at_intervals(
    describe: Callable[[], str], say: Say, wait: Callable[[float], bool | None]
) -> None:
    """Prints the description at intervals, until `wait`, which is called with seconds, returns
    True.
    """
    while not wait(LOG_EVERY_S):
        say(describe())


class ProgressLog:
    """Where the work is, in one line; the clock is that of the bars."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._began_s = bars.get_time()

    def describe(self) -> str:
        """What is under way, how much of it is done, and the remaining time where it is known."""
        lines = [_describe_task(task) for task in self._bars.tasks if not task.finished]
        so_far = f"{_clock(self._bars.get_time() - self._began_s)} so far"
        return "; ".join([*lines, so_far])


def _describe_task(task: Task) -> str:
    done = f"{task.description} {_Done().render(task).plain.strip()}".strip()
    if task.total is None or task.time_remaining is None:
        return done
    return f"{done}, {_Left().render(task).plain}"


class _Done(ProgressColumn):
    """Column: how many of how many, or the share of the whole."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text(task.fields["note"]())
        if task.total <= 1:
            return Text(f"{task.percentage:3.0f} %")
        return Text(f"{task.completed:g} of {task.total:g}")


class _Left(ProgressColumn):
    """Column: the remaining time; of work without a known end the elapsed time."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text(_clock(task.elapsed or 0.0))
        if task.time_remaining is None:
            return Text("")
        return Text(f"{_clock(task.time_remaining)} left")


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds))).removeprefix("0:")


class ProgressLines:
    """Lines of progress; `report_progress` may be called from any thread."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}
        self._without_end: list[TaskID] = []

    def report(self, what: str, done: float, of: float) -> None:
        """Updates the line of `what`, which is added when first named. Progress on it ends the
        lines of work without a known end.
        """
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(_short(what), total=of, completed=int(done))
        self._bars.update(self._tasks[what], completed=done, total=of)
        while done and self._without_end:
            self._bars.remove_task(self._without_end.pop())

    def counting(self, what: str) -> ProgressCount:
        """A callback for work that counts its items."""
        return lambda done, of: self.report(what, done, of)

    def show_unbounded(self, what: str, note: Callable[[], str]) -> None:
        """A line for work of unknown amount; `note` is called again and again for the text to
        show.
        """
        self._without_end.append(self._bars.add_task(_short(what), total=None, note=note))

    def share(self, part: str, share: float) -> None:
        """One line for work whose parts follow each other: shows the current part, and the share
        of the whole.
        """
        if "" not in self._tasks:
            self._tasks[""] = self._bars.add_task(_short(part), total=1.0)
        self._bars.update(self._tasks[""], completed=share, description=_short(part))


@contextmanager
def progress(quiet: bool) -> Iterator[ProgressLines]:
    """Lines that disappear when the work is done."""
    console = ErrorConsole(stderr=True, quiet=quiet, highlight=False)
    columns = (
        SpinnerColumn("line"),
        TextColumn("{task.description}"),
        BarColumn(BAR_WIDTH),
        _Done(),
        _Left(),
    )
    bars = Progress(
        *columns,
        console=console,
        disable=quiet or not console.is_terminal,
        transient=True,
        # Results that are redirected to a file must still get there.
        redirect_stdout=sys.stdout.isatty(),
        speed_estimate_period=LONG_S,
    )
    with bars, _log_at_intervals(bars, ErrorConsole(file=sys.stderr, quiet=quiet, highlight=False)):
        yield ProgressLines(bars)


def _short(what: str) -> str:
    if len(what) <= WIDEST:
        return what
    return what[: WIDEST - 2] + ".."


def announce_first_compile(
    bars: ProgressLines, quiet: bool, say: Say = lambda line: echo(line, err=True)
) -> None:
    """To be called before the first computation of a command; prints nothing where the model is
    compiled already.
    """
    # numba takes half a second to import, which commands without a model need not wait for.
    from rfca_rig.model.kernel.compiled import count_compiled, is_warm

    if not is_warm() and not quiet:
        say(COMPILE_NOTICE)
        bars.show_unbounded("compiling", lambda: f"{count_compiled()} functions")


def compile_ahead(rig: "RigModel") -> None:
    """Compiles what only a diagnosis needs in a process of its own, while this one compiles what a
    run needs; nothing waits for it.

    It does nothing where the model is compiled already, or where one core would have to do both.
    """
    from rfca_rig.model.kernel.compiled import is_warm

    if is_warm() or machine_cores() < 2 or not hasattr(os, "nice"):
        return
    nowhere = subprocess.DEVNULL
    # Without this process, the diagnosis compiles later.
    with suppress(OSError):
        # In a session of its own: ^C ends the run, and the compiled code serves the next one.
        command = python_command("-c", COMPILE_AHEAD)
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere, start_new_session=True
        )
        pipe = cast(IO[bytes], process.stdin)
        with pipe:
            pickle.dump(rig, pipe)
        # Somebody has to take its exit code, or a notebook would keep it as a zombie.
        Thread(target=process.wait, daemon=True).start()
