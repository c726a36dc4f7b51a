"""Recordings of any kind as xarray datasets and pandas tables, and what all results of the library
share.

Shared are tables for pandas and for a notebook's page, axes to draw into, and progress bars.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfca_rig.analysis.phases import describe_stroke
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.opening import experiment_among, open_experiment, open_recordings
from rfca_rig.errors import BadInput
from rfca_rig.escaping import html_text
from rfca_rig.recording.model import Recording, StaticStage, Stroke

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING

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
class OpenedRecordings:
    """Recordings of one rig.

    Parameters
    ----------
    path
        Where they lie.
    content
        What the files hold: a `Recording` of a leg, or an `Experiment` with a mechanism.
    allow_outside
        Files outside the folder may be read, too.
    """

    path: Path
    content: Recording | Experiment
    allow_outside: bool = False

    @property
    def title(self) -> str:
        """The title in the files."""
        return self.content.title

    @property
    def strokes(self) -> Sequence[Stroke | MechanismRun]:
        """The recorded motions: strokes of a leg, else runs."""
        if isinstance(self.content, Recording):
            return self.content.strokes
        return self.content.runs

    def __len__(self) -> int:
        return len(self.strokes)

    def to_xarray(self, number: int = 0) -> "xarray.Dataset":
        """The samples of motion `number` in SI units, as measured.

        A leg's devices have time bases of their own, so each has a dimension of its own:
        `force_t_s`, `shaft_t_s`.
        """
        motion = self._motion(number)
        dataset = require("xarray").Dataset
        if isinstance(motion, Stroke):
            samples: xarray.Dataset = dataset(*_stroke_data(motion))
            return samples
        times = {"t_s": ("t_s", motion.t_s, {"units": "s"})}
        about = {"title": self.title, "run": motion.label, "condition": motion.condition}
        samples = dataset(
            {
                name: ("t_s", values, {"units": unit})
                for name, values, unit in self._columns(motion)
            },
            times,
            about,
        )
        return samples

    def table(self) -> "pandas.DataFrame":
        """A row per motion: its condition, and of a stroke the valley."""
        return make_frame(self._rows())

    def static_table(self) -> "pandas.DataFrame":
        """A row per static stage of a leg: means after settling, hinge angles with their
        standard deviations.
        """
        stages: Iterable[StaticStage] = (
            self.content.static if isinstance(self.content, Recording) else ()
        )
        return make_frame([_static_row(stage) for stage in stages], STATIC_COLUMNS)

    def plot(self, number: int = 0, ax: "Axes | None" = None) -> "Axes":
        """Draw the forces of a stroke, or the signals of a run, over time into `ax`, or into a
        new figure.
        """
        motion = self._motion(number)
        ax = make_axes(ax)
        if isinstance(motion, Stroke):
            shown = [
                (name, *channel)
                for name in ("fz_N", "fy_N")
                if (channel := motion.channel(name)) is not None
            ]
            ax.set_ylabel("force on the sensor in N")
        else:
            shown = [
                (f"{name} in {unit}", motion.t_s, values)
                for name, values, unit in self._columns(motion)
            ]
        for label, t_s, values in shown:
            ax.plot(t_s, values, label=label)
        ax.set(xlabel="time in s", title=f"{self.title}, {number}")
        ax.legend()
        return ax

    def __repr__(self) -> str:
        return f"OpenedRecordings({str(self.path)!r}: {self.title}, {len(self)} motions)"

    def _repr_html_(self) -> str:
        return html_table(repr(self), self._rows())

    def _motion(self, number: int) -> Stroke | MechanismRun:
        if not -len(self) <= number < len(self):
            raise BadInput(
                f"{self.path}: holds {len(self)} motions, numbered from 0; there is no {number}"
            )
        return self.strokes[number]

    def _rows(self) -> list[Row]:
        return [
            describe_stroke(motion) if isinstance(motion, Stroke) else _run_row(motion)
            for motion in self.strokes
        ]

    def _columns(self, run: MechanismRun) -> list[tuple[str, Any, str]]:
        assert isinstance(self.content, Experiment)
        signals = [
            (f"{s.name}.{s.quantity}", run.signals[:, k], s.unit)
            for k, s in enumerate(self.content.signals)
        ]
        return signals + [
            (f"{name}.command", run.commands[:, k], "")
            for k, name in enumerate(self.content.actuators)
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
        return OpenedRecordings(path, open_experiment(path, allow_outside), allow_outside)
    return OpenedRecordings(path, open_recordings([path], as_is, allow_outside)[0], allow_outside)
