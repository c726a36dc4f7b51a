"""Recordings of any kind as xarray datasets and pandas tables, and what all results of the library
share.

Shared are tables for pandas and for a notebook's page, axes to draw into, and progress bars.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfca_rig.analysis.phases import describe_stroke
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.opening import experiment_among, open_experiment, open_recordings
from rfca_rig.diagnosis.problem import Row
from rfca_rig.errors import BadInput
from rfca_rig.escaping import html_text
from rfca_rig.recording.model import Recording, StaticStage, Stroke

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

EXTRA = "notebook"
# Height of a page within a notebook: a figure with its caption fits.
FRAME_HEIGHT_PX = 600


def require(module: str) -> Any:
    """An optional module. Raises BadInput with the command that installs it."""
    try:
        return import_module(module)
    except ImportError:
        raise BadInput(
            f'{module} is not installed; pip install "rfca-rig[{EXTRA}]" brings it'
        ) from None


def make_frame(rows: Sequence[Row], columns: Sequence[str] = ()) -> "pandas.DataFrame":
    """A pandas table of rows; `columns` are those of a table without rows."""
    frame: pandas.DataFrame = require("pandas").DataFrame(
        list(rows), columns=None if rows else list(columns)
    )
    return frame


def html_table(title: str, rows: Sequence[Row]) -> str:
    """A table for a notebook's page, with its title above; every text is escaped."""
    head = "".join(f"<th>{html_text(name)}</th>" for name in (rows[0] if rows else ()))
    body = "".join(
        "<tr>" + "".join(f"<td>{html_text(_text(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows
    )
    return f"<p><b>{html_text(title)}</b></p>" + (
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
    )


def html_page(page: str) -> str:
    """A whole page for a notebook's page, in a frame of its own: their styles do not mix, and
    nothing of the page runs.
    """
    style = f"width: 100%; height: {FRAME_HEIGHT_PX}px; border: 0"
    return f'<iframe sandbox srcdoc="{html_text(page)}" style="{style}"></iframe>'


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def make_axes(ax: "Axes | None") -> "Axes":
    """The given axes, or those of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot  # noqa: PLC0415  (its import takes half a second)

    return pyplot.subplots()[1]


@contextmanager
def show_progress(what: str, wanted: bool) -> Iterator[Callable[[str, float], None]]:
    """A callback for the current step and the share done, which moves a bar: a widget in a
    notebook, a line in a terminal.

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


STATIC_COLUMNS = ("height_mm", "stage", "direction", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")


@dataclass(frozen=True)
class OpenedRecordings(ABC):
    """Recordings of one rig.

    Parameters
    ----------
    path
        Where they lie.
    allow_outside
        Files outside the folder may be read, too.
    """

    path: Path
    allow_outside: bool

    @property
    @abstractmethod
    def title(self) -> str:
        """The title in the files."""

    @property
    @abstractmethod
    def strokes(self) -> Sequence[Stroke | MechanismRun]:
        """The recorded motions: strokes of a leg, else runs."""

    def __len__(self) -> int:
        return len(self.strokes)

    @abstractmethod
    def to_xarray(self, number: int = 0) -> "xarray.Dataset":
        """The samples of motion `number` in SI units, as measured.

        A leg's devices have time bases of their own, so each has a dimension of its own:
        `force_t_s`, `shaft_t_s`.
        """

    def table(self) -> "pandas.DataFrame":
        """A row per motion: its condition, and of a stroke the valley."""
        return make_frame(self._rows())

    def static_table(self) -> "pandas.DataFrame":
        """A row per static stage of a leg: means after settling, hinge angles with their
        standard deviations.
        """
        return make_frame([], STATIC_COLUMNS)

    def plot(self, number: int = 0, ax: "Axes | None" = None) -> "Axes":
        """Draw the forces of a stroke, or the signals of a run, over time into `ax`, or into a
        new figure.
        """
        self._check(number)
        ax = make_axes(ax)
        for label, t_s, values in self._curves(number):
            ax.plot(t_s, values, label=label)
        ax.set(xlabel="time in s", title=f"{self.title}, {number}")
        ax.legend()
        return ax

    def __repr__(self) -> str:
        return f"OpenedRecordings({str(self.path)!r}: {self.title}, {len(self)} motions)"

    def _repr_html_(self) -> str:
        return html_table(repr(self), self._rows())

    def _check(self, number: int) -> None:
        if not -len(self) <= number < len(self):
            raise BadInput(
                f"{self.path}: holds {len(self)} motions, numbered from 0; there is no {number}"
            )

    @abstractmethod
    def _rows(self) -> list[Row]:
        """A row per motion."""

    @abstractmethod
    def _curves(self, number: int) -> list[tuple[str, Any, Any]]:
        """What `plot` draws: label, times and values."""


@dataclass(frozen=True, repr=False)
class LegRecordings(OpenedRecordings):
    """Recordings of a leg."""

    recording: Recording

    @property
    def title(self) -> str:
        """The title of the recording."""
        return self.recording.title

    @property
    def strokes(self) -> Sequence[Stroke]:
        """The recorded strokes."""
        return self.recording.strokes

    def to_xarray(self, number: int = 0) -> "xarray.Dataset":
        """The samples of a stroke, with a dimension per device."""
        self._check(number)
        samples: xarray.Dataset = require("xarray").Dataset(*_stroke_data(self.strokes[number]))
        return samples

    def static_table(self) -> "pandas.DataFrame":
        """A row per static stage."""
        return make_frame([_static_row(stage) for stage in self.recording.static], STATIC_COLUMNS)

    def plot(self, number: int = 0, ax: "Axes | None" = None) -> "Axes":
        """Draw the forces of a stroke."""
        ax = super().plot(number, ax)
        ax.set_ylabel("force on the sensor in N")
        return ax

    def _rows(self) -> list[Row]:
        return [describe_stroke(stroke) for stroke in self.strokes]

    def _curves(self, number: int) -> list[tuple[str, Any, Any]]:
        channels = ((name, self.strokes[number].channel(name)) for name in ("fz_N", "fy_N"))
        return [(name, *channel) for name, channel in channels if channel is not None]


@dataclass(frozen=True, repr=False)
class MechanismRecordings(OpenedRecordings):
    """Recordings of a mechanism."""

    experiment: Experiment

    @property
    def title(self) -> str:
        """The title of the experiment."""
        return self.experiment.title

    @property
    def strokes(self) -> Sequence[MechanismRun]:
        """The recorded runs."""
        return self.experiment.runs

    def to_xarray(self, number: int = 0) -> "xarray.Dataset":
        """The samples of a run."""
        self._check(number)
        run = self.strokes[number]
        samples: xarray.Dataset = require("xarray").Dataset(
            {name: ("t_s", values, {"units": unit}) for name, values, unit in self._columns(run)},
            {"t_s": ("t_s", run.t_s, {"units": "s"})},
            {"title": self.title, "run": run.label, "condition": run.condition},
        )
        return samples

    def _rows(self) -> list[Row]:
        return [_run_row(run) for run in self.strokes]

    def _curves(self, number: int) -> list[tuple[str, Any, Any]]:
        run = self.strokes[number]
        return [(f"{name} in {unit}", run.t_s, values) for name, values, unit in self._columns(run)]

    def _columns(self, run: MechanismRun) -> list[tuple[str, Any, str]]:
        signals = [
            (f"{s.name}.{s.quantity}", run.signals[:, k], s.unit)
            for k, s in enumerate(self.experiment.signals)
        ]
        return signals + [
            (f"{name}.command", run.commands[:, k], "")
            for k, name in enumerate(self.experiment.actuators)
        ]


def _stroke_data(stroke: Stroke) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Variables, coordinates and attributes of a stroke."""
    data: dict[str, Any] = {}
    times: dict[str, Any] = {}
    for device, stream in stroke.streams.items():
        along = f"{device}_t_s"
        times[along] = (along, stream.t_s, {"units": "s"})
        # Two devices may give the same quantity, as motor and encoder give an angle.
        data |= {
            name if name not in data else f"{device}_{name}": (along, c.values, {"units": c.unit})
            for name, c in stream.columns.items()
        }
    return (
        data,
        times,
        {
            "height_mm": 1e3 * stroke.height_m,
            "speed_rad_s": stroke.speed_rad_s,
            "repeat": stroke.repeat,
        },
    )


def _run_row(run: MechanismRun) -> Row:
    return {
        "run": run.label,
        "condition": run.condition,
        "duration_s": float(run.t_s[-1] - run.t_s[0]),
        "samples": len(run.t_s),
    }


def _static_row(stage: StaticStage) -> Row:
    hinges = {f"hinge{k}_deg": angle for k, angle in enumerate(stage.hinge_deg, start=2)}
    stds = {f"hinge{k}_std_deg": std for k, std in enumerate(stage.hinge_std_deg, start=2)}
    columns = {name: getattr(stage, name) for name in STATIC_COLUMNS[1:]}
    return {
        "height_mm": round(1e3 * stage.height_m, 6),
        **columns,
        **hinges,
        **stds,
        "settled": stage.settled,
        "photo": stage.photo,
    }


def open_path(
    path: str | Path, *, as_is: bool = False, allow_outside: bool = False
) -> OpenedRecordings:
    """Open recordings: a run, an .h5 file, a campaign, a campaign of a pendulum, or a folder with
    experiment.toml.

    Parameters
    ----------
    path
        The folder or file.
    as_is
        Take values of a campaign that are probably in another unit; otherwise they are refused with
        a guess.
    allow_outside
        Read files outside the folder, too, to which its links or its model lead.

    Raises
    ------
    BadInput
        One line where nothing there can be used.

    Examples
    --------
    >>> import rfca_rig as rr
    >>> recordings = rr.open("runs/SIM-table-ii-001")  # doctest: +SKIP
    >>> recordings.to_xarray(0)["fz_N"].min()  # doctest: +SKIP
    """
    path = Path(path)
    if experiment_among([path]) is not None:
        experiment = open_experiment(path, allow_outside)
        return MechanismRecordings(path, allow_outside, experiment)
    (recording,) = open_recordings([path], as_is, allow_outside)
    return LegRecordings(path, allow_outside, recording)
