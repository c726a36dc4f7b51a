"""A rig file, and what its model predicts of one stroke."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.prediction import Prediction, predict_stroke
from rfca_rig.cli.paths import find_rig
from rfca_rig.description.model_file import read_model_file
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.notebook.recordings import html_table, make_axes, require

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Rig:
    """A rig: its file, and the nominal model in SI units.

    Parameters
    ----------
    name
        The path, or the name of a file that comes with the package.
    file
        The content of the rig file, with the units of its keys.
    model
        The nominal model of leg, ground, sensor and drive.
    """

    name: str
    file: RigFile
    model: RigModel

    @classmethod
    def from_file(cls, path: str | Path = "twin", model: str | Path | None = None) -> "Rig":
        """Read a rig file.

        Parameters
        ----------
        path
            A path, or a name such as "twin".
        model
            A model file, for example of a fit or a diagnosis, in place of the nominal model.

        Raises
        ------
        BadInput
            One line with file and line where a file cannot be used.
        """
        file = read_rig(find_rig(str(path)))
        return cls(
            str(path), file, file.model() if model is None else read_model_file(Path(model)).model()
        )

    @property
    def is_real(self) -> bool:
        """Whether it drives hardware; False for a twin."""
        return self.file.is_real

    def __repr__(self) -> str:
        return f"Rig({self.name!r}: {self.file.rig.title}, {'REAL' if self.is_real else 'SIM'})"

    def _repr_html_(self) -> str:
        sections = (
            {"section": key, "values": ", ".join(f"{k} = {v}" for k, v in of.items())}
            for key, of in self.file.nominal().items()
        )
        return html_table(repr(self), list(sections))


@dataclass(frozen=True)
class SimulatedResult:
    """One predicted stroke."""

    prediction: Prediction

    @property
    def summary(self) -> dict[str, float | str | None]:
        """Valley, peak force and peak torque, each with its unit in its name."""
        return self.prediction.summary()

    def to_xarray(self) -> "xarray.Dataset":
        """Shaft angle, forces and torques over `t_s`, and per link the angle and the normal
        force at its end; units are attributes.
        """
        stroke = self.prediction.stroke
        along = {
            "shaft_angle_rad": (stroke.shaft_angle_rad, "rad"),
            "fy_N": (stroke.fy_N, "N"),
            "fz_N": (stroke.fz_N, "N"),
            "tx_Nm": (stroke.tx_Nm, "N m"),
            "shaft_torque_Nm": (stroke.shaft_torque_Nm, "N m"),
        }
        per_link = {"link_angle_rad": (stroke.q_rad, "rad"), "normal_N": (stroke.normal_N, "N")}
        data: dict[str, tuple[tuple[str, ...], Floats, dict[str, str]]]
        data = {name: (("t_s",), values, {"units": unit}) for name, (values, unit) in along.items()}
        data |= {
            name: (("t_s", "link"), values, {"units": unit})
            for name, (values, unit) in per_link.items()
        }
        coordinates = {
            "t_s": ("t_s", stroke.t_s, {"units": "s"}),
            "link": np.arange(1, stroke.q_rad.shape[1] + 1),
        }
        figures = {name: value for name, value in self.summary.items() if value is not None}
        dataset: xarray.Dataset = require("xarray").Dataset(data, coordinates, figures)
        return dataset

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw fy and fz over time into `ax`, or into a new figure."""
        ax = make_axes(ax)
        stroke = self.prediction.stroke
        for name, values in (("fz", stroke.fz_N), ("fy", stroke.fy_N)):
            ax.plot(stroke.t_s, values, label=name)
        ax.set(xlabel="time in s", ylabel="force on the sensor in N", title=_title(self.prediction))
        ax.legend()
        return ax

    def _repr_html_(self) -> str:
        return html_table(
            _title(self.prediction),
            [{"quantity": name, "value": value} for name, value in self.summary.items()],
        )


def _title(prediction: Prediction) -> str:
    return f"stroke at {1e3 * prediction.height_m:g} mm, {prediction.speed_rad_s:g} rad/s"


def simulate(
    rig: Rig | str | Path = "twin",
    *,
    height_mm: float,
    speed_rad_s: float,
    sweep_deg: float = 200.0,
) -> SimulatedResult:
    """Simulate one stroke at constant shaft speed.

    Parameters
    ----------
    rig
        A rig, or the path or name of a rig file.
    height_mm
        Height of the shaft above the ground, 1 to 1000 mm.
    speed_rad_s
        Speed of the shaft, 0.01 to 100 rad/s.
    sweep_deg
        Angle by which the shaft turns, 1 to 330 degrees.

    Raises
    ------
    BadInput
        For a value outside of its range.
    SimulationFailed
        Where the integrator gives up.

    Examples
    --------
    >>> import rfca_rig as rr
    >>> stroke = rr.simulate(height_mm=215, speed_rad_s=2.433)
    >>> round(stroke.summary["valley_fz_N"], 1)
    -53.4
    """
    for name, value, low, high in (
        ("height_mm", height_mm, 1, 1000),
        ("speed_rad_s", speed_rad_s, 0.01, 100),
        ("sweep_deg", sweep_deg, 1, 330),
    ):
        if not low <= value <= high:
            raise BadInput(f"{name} = {value!r}: should be a number from {low:g} to {high:g}")
    if isinstance(rig, Rig):
        model = rig.model
    else:
        model = Rig.from_file(rig).model
    return SimulatedResult(predict_stroke(model, height_mm / 1e3, speed_rad_s, sweep_deg))
