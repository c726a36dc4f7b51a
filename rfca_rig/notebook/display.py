"""What all results of the library share: tables for pandas and for a notebook's page, axes to draw into, progress bars."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

Row = Mapping[str, object]
EXTRA = "notebook"


def require(module: str) -> Any:
    """An optional module. Raises BadInput with the command that installs it."""
    try:
        return import_module(module)
    except ImportError:
        raise BadInput(f'{module} is not installed; pip install "rfca-rig[{EXTRA}]" brings it') from None


def make_frame(rows: Sequence[Row], columns: Sequence[str] = ()) -> "pandas.DataFrame":
    """A pandas table of rows; `columns` are those of a table without rows."""
    frame: pandas.DataFrame = require("pandas").DataFrame(list(rows), columns=None if rows else list(columns))
    return frame


def html_table(title: str, rows: Sequence[Row]) -> str:
    """A table for a notebook's page, with its title above; every text is escaped."""
    head = "".join(f"<th>{escape(name)}</th>" for name in (rows[0] if rows else ()))
    body = "".join("<tr>" + "".join(f"<td>{escape(_text(value))}</td>" for value in row.values()) + "</tr>" for row in rows)
    return f"<p><b>{escape(title)}</b></p>" + (f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if rows else "")


def _text(value: object) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def make_axes(ax: "Axes | None") -> "Axes":
    """The given axes, or those of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot  # noqa: PLC0415  (its import takes half a second)

    return pyplot.subplots()[1]


@contextmanager
def show_progress(what: str, wanted: bool) -> Iterator[Callable[[str, float], None]]:
    """A callback for the current step and the share done, which moves a bar: a widget in a notebook, a line in a terminal.

    Without the optional tqdm, and where none is wanted, there is no bar.
    """
    bar = _make_bar(what) if wanted else None

    def move(step: str, share: float) -> None:
        if bar is not None:
            bar.set_postfix_str(step, refresh=False)
            bar.update(round(100.0 * share) - bar.n)

    try:
        yield move
    finally:
        if bar is not None:
            bar.close()


def _make_bar(what: str) -> Any:
    try:
        from tqdm.auto import tqdm  # noqa: PLC0415  (optional)
    except ImportError:
        return None
    # Steps are few and take seconds, so each is shown at once.
    return tqdm(total=100, desc=what, unit="%", leave=False, mininterval=0.0)
