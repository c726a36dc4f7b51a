"""Fits a rig's model to strokes: to all that a recording holds of them, or to their valleys alone.

Fits the model to valleys alone: rows of time and force, as in Table II of the paper, without any
recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.fit import Search, fit
from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.fitting.residuals import (
    StrokeProblem,
    StrokeWindow,
    make_stroke_problem,
    mean_start_rad,
    simulate_points,
)
from rfca_rig.analysis.fitting.result import FitResult
from rfca_rig.analysis.fitting.scatter import USUAL_SCATTER
from rfca_rig.analysis.matched_simulation import DURATION_FACTOR, GRID_S, Shaft
from rfca_rig.analysis.phases import Undetermined, find_valley
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import Job, SimulatedStroke
from rfca_rig.recording.model import Recording, Stroke, refuse_other_nominal

Floats = NDArray[np.float64]

# Rest before the start that is simulated, because the valley's level at rest is needed.
BEFORE_S = 0.1


@dataclass(frozen=True)
class StrokeComparison:
    """What is compared: how the simulated shaft turns, and which part of a stroke counts."""

    shaft: Shaft = "recorded"
    window: StrokeWindow = field(default_factory=StrokeWindow)


def fit_recordings(
    recordings: Sequence[Recording],
    names: Sequence[str] = (),
    comparison: StrokeComparison | None = None,
    search: Search | None = None,
) -> FitResult:
    """Fit the named parameters, or all of [known_to], to all strokes of the recordings.

    Parameters
    ----------
    recordings
        Recordings with the same nominal model and the same [known_to].
    names
        Parameters to fit; empty for all that have a prior.
    comparison
        Motion of the simulated shaft, and the part of a stroke that counts.
    search
        Starts, limits and progress.

    Raises
    ------
    BadInput
        Where the recordings cannot be used, together or at all.
    SimulationFailed
        Where the model cannot be computed.

    Notes
    -----
    Where the shaft follows its recording, `start_angle` is the correct reading of the encoder. Its
    prior is centred on the mean recorded start.
    """
    comparison = comparison or StrokeComparison()
    nominal, known_to = _common(recordings)
    rig = nominal_model(nominal)
    strokes = [stroke for recording in recordings for stroke in recording.strokes]
    noise_std = nominal["sensor"].get("noise_std") or {}
    problem = make_stroke_problem(
        group_by_condition(strokes),
        rig.drive.ramp_s,
        noise_std,
        comparison.shaft,
        comparison.window,
    )
    start = rig
    # The encoder's own reading is the best guess of the start; the fit then corrects its zero.
    if comparison.shaft == "recorded":
        start = _starting_as_recorded(rig, strokes)
    centre = ModelPoint(start)
    result = fit(problem, make_prior(names, centre, known_to), search, USUAL_SCATTER)
    return _with_rms(result, problem, comparison.window)


def _common(recordings: Sequence[Recording]) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    first = recordings[0]
    # One fit has one prior.
    refuse_other_nominal(recordings, "fit them one by one")
    return first.nominal, first.known_to


def _starting_as_recorded(rig: RigModel, strokes: Sequence[Stroke]) -> RigModel:
    start_rad = mean_start_rad(strokes)
    if start_rad is None:
        return rig
    return replace(rig, leg=replace(rig.leg, start_angle_rad=start_rad))


def _with_rms(result: FitResult, problem: StrokeProblem, window: StrokeWindow) -> FitResult:
    return replace(
        result,
        rms_before=problem.rms(result.space.centre),
        rms=problem.rms(result.supposed),
        noise=problem.noise(),
        notes=(window.in_words(), *problem.left_out),
    )


@dataclass(frozen=True)
class ValleyRow:
    """The measured valley of one condition, and one standard deviation of its time and its
    force.
    """

    height_m: float
    speed_rad_s: float
    time_s: float
    fz_N: float
    time_std_s: float
    fz_std_N: float

    def job(self, supposed: ModelPoint) -> Job:
        """The stroke at this condition, whose valley is found by the same estimator as that of a
        recorded one.
        """
        t_s = GRID_S * np.arange(
            -round(BEFORE_S / GRID_S),
            int(DURATION_FACTOR * self.time_s / GRID_S) + 1,
            dtype=np.float64,
        )
        motion = ramp_to_speed(
            supposed.rig.leg.start_angle_rad,
            self.speed_rad_s,
            supposed.rig.drive.ramp_s,
            float(t_s[-1]),
        )
        return Job(supposed.rig, self.height_m + supposed.height_offset_m, motion, t_s)

    def residual(self, stroke: SimulatedStroke | SimulationFailed) -> Floats | None:
        """Time and force of its valley less the measured ones, in standard deviations, (2,);
        None where it has no valley.
        """
        if isinstance(stroke, SimulationFailed) or isinstance(
            valley := find_valley(stroke.t_s, stroke.fz_N), Undetermined
        ):
            return None
        return np.array(
            [
                (valley.time_s - self.time_s) / self.time_std_s,
                (valley.fz_N - self.fz_N) / self.fz_std_N,
            ]
        )


@dataclass(frozen=True)
class ValleyProblem:
    """Two residuals per row, time and force: m is twice the number of rows."""

    rows: tuple[ValleyRow, ...]

    @property
    def stroke_of_row(self) -> NDArray[np.intp]:
        """Index of the row of the table, (m,)."""
        return np.repeat(np.arange(len(self.rows)), 2)

    def residuals(self, supposed: Sequence[ModelPoint]) -> list[Floats | None]:
        """Residuals (m,) at each point, in standard deviations; None where the model has no
        valley at one of the rows.
        """
        by_point = simulate_points([row.job for row in self.rows], supposed)
        return [self._against(strokes) for strokes in by_point]

    def _against(self, strokes: Sequence[SimulatedStroke | SimulationFailed]) -> Floats | None:
        residuals = []
        for row, stroke in zip(self.rows, strokes, strict=True):
            residual = row.residual(stroke)
            if residual is None:
                return None
            residuals.append(residual)
        return np.concatenate(residuals)

    def rms(self, supposed: ModelPoint) -> dict[str, float]:
        """Root mean square of simulated minus measured, by quantity; NaN where the model has no
        valley.
        """
        residuals = self.residuals([supposed])[0]
        if residuals is None:
            return dict.fromkeys(self.noise(), float("nan"))
        misses = residuals.reshape(-1, 2) * [[row.time_std_s, row.fz_std_N] for row in self.rows]
        return dict(
            zip(
                self.noise(),
                (float(miss) for miss in np.sqrt(np.mean(misses**2, axis=0))),
                strict=True,
            )
        )

    def noise(self) -> dict[str, float]:
        """Root mean square of the rows' standard deviations, by quantity."""
        squares = np.mean([[row.time_std_s**2, row.fz_std_N**2] for row in self.rows], axis=0)
        return dict(
            zip(
                ("valley_time_s", "valley_fz_N"),
                (float(square) for square in np.sqrt(squares)),
                strict=True,
            )
        )


def fit_valleys(
    rig: RigModel,
    rows: Sequence[ValleyRow],
    names: Sequence[str],
    known_to: Mapping[str, float],
    search: Search | None = None,
) -> FitResult:
    """Fit the named parameters of `rig` to the rows, with the shaft at constant speed as in the
    paper.

    Parameters
    ----------
    rig
        The nominal model.
    rows
        Measured valleys with their standard deviations.
    names
        Parameters to fit.
    known_to
        As in the section of that name.
    search
        Starts, limits and progress.

    Raises
    ------
    BadInput
        For an unknown parameter.
    SimulationFailed
        Where `rig` as given has no valley at one of the rows.

    Notes
    -----
    Without a prior, two numbers per row determine at most two parameters per row.
    """
    problem = ValleyProblem(tuple(rows))
    centre = ModelPoint(rig)
    result = fit(problem, make_prior(names, centre, known_to), search)
    return replace(
        result,
        rms_before=problem.rms(centre),
        rms=problem.rms(result.supposed),
        noise=problem.noise(),
    )
