"""How far something is that takes more than a moment: a line on the error stream, only where a person watches.

Silent when piped, and where a command prints JSON. What remains is told from what was done so far; where nobody knows how much there is to
do, the line says how long it has been going on instead.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.text import Text

from rfca_rig.progress import Watcher

LONG_S = 1e4  # parts differ in length: what remains is told from all of them, not from the last half minute
BAR_WIDTH = 20
WIDEST = 34


class _Done(ProgressColumn):
    """How many of how many, or which part of the whole."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text(task.fields["note"]())
        return Text(f"{task.percentage:3.0f} %" if task.total <= 1 else f"{task.completed:g} of {task.total:g}")


class _Left(ProgressColumn):
    """The time that remains; of what has no known end the time that it took so far."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text(_clock(task.elapsed or 0.0))
        return Text("" if task.time_remaining is None else f"{_clock(task.time_remaining)} left")


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds))).removeprefix("0:")


class Bars:
    """Lines of progress; `told` may be called from any thread."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}
        self._without_end: list[TaskID] = []

    def told(self, what: str, done: float, of: float) -> None:
        """A line for each `what`, in the order of their coming; the first that is done ends what had no known end."""
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(_short(what), total=of, completed=int(done))
        self._bars.update(self._tasks[what], completed=done, total=of)
        while done and self._without_end:
            self._bars.remove_task(self._without_end.pop())

    def counting(self, what: str) -> Watcher:
        """For work that counts its items."""
        return lambda done, of: self.told(what, done, of)

    def going_on(self, what: str, note: Callable[[], str]) -> None:
        """A line for work of which nobody knows how much there is; `note` is asked again and again what there is to be said of it."""
        self._without_end.append(self._bars.add_task(_short(what), total=None, note=note))

    def share(self, part: str, share: float) -> None:
        """One line for work whose parts follow each other: it names the part that is under way, and tells how much of all is done."""
        if "" not in self._tasks:
            self._tasks[""] = self._bars.add_task(_short(part), total=1.0)
        self._bars.update(self._tasks[""], completed=share, description=_short(part))


@contextmanager
def progress(quiet: bool) -> Iterator[Bars]:
    """Lines that go away when the work is done."""
    console = Console(stderr=True, quiet=quiet, highlight=False)
    columns = (SpinnerColumn("line"), TextColumn("{task.description}"), BarColumn(BAR_WIDTH), _Done(), _Left())
    bars = Progress(
        *columns,
        console=console,
        disable=quiet or not console.is_terminal,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # results that go into a file must go on doing so
        speed_estimate_period=LONG_S,
    )
    with bars:
        yield Bars(bars)


def _short(what: str) -> str:
    return what if len(what) <= WIDEST else what[: WIDEST - 2] + ".."
