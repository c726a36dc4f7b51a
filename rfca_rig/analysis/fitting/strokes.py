"""Fits a recording's nominal model to its strokes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from rfca_rig.analysis.fitting.fit import Search, fit
from rfca_rig.analysis.fitting.motions import mean_start_rad
from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.fitting.residuals import StrokeProblem, StrokeWindow, make_stroke_problem
from rfca_rig.analysis.fitting.result import FitResult
from rfca_rig.analysis.fitting.scatter import USUAL_SCATTER
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.nominal_model import nominal_model
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.model import Recording, Stroke


@dataclass(frozen=True)
class StrokeComparison:
    """What is compared: how the simulated shaft turns, and which part of a stroke counts."""

    shaft: Shaft = "recorded"
    window: StrokeWindow = field(default_factory=StrokeWindow)


def fit_recordings(
    recordings: Sequence[Recording], names: Sequence[str] = (), comparison: StrokeComparison | None = None, search: Search | None = None
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
    Where the shaft follows its recording, `start_angle` is the correct reading of the encoder. Its prior is centred on the mean recorded
    start.
    """
    comparison = comparison or StrokeComparison()
    nominal, known_to = _common(recordings)
    rig = nominal_model(nominal)
    strokes = [stroke for recording in recordings for stroke in recording.strokes]
    noise_std = nominal["sensor"].get("noise_std") or {}
    problem = make_stroke_problem(group_by_condition(strokes), rig.drive.ramp_s, noise_std, comparison.shaft, comparison.window)
    # The encoder's own reading is the best guess of the start; the fit then corrects its zero.
    centre = ModelPoint(_starting_as_recorded(rig, strokes) if comparison.shaft == "recorded" else rig)
    result = fit(problem, make_prior(names, centre, known_to), search, USUAL_SCATTER)
    return _with_rms(result, problem, comparison.window)


def _common(recordings: Sequence[Recording]) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    first = recordings[0]
    for other in recordings[1:]:
        # One fit has one prior, so all recordings must state the same.
        if other.nominal != first.nominal or other.known_to != first.known_to:
            raise BadInput(f"{other.title!r} believes other values of the rig than {first.title!r}; fit them one by one")
    return first.nominal, first.known_to


def _starting_as_recorded(rig: RigModel, strokes: Sequence[Stroke]) -> RigModel:
    start_rad = mean_start_rad(strokes)
    return rig if start_rad is None else replace(rig, leg=replace(rig.leg, start_angle_rad=start_rad))


def _with_rms(result: FitResult, problem: StrokeProblem, window: StrokeWindow) -> FitResult:
    return replace(
        result,
        rms_before=problem.rms(result.space.centre),
        rms=problem.rms(result.supposed),
        noise=problem.noise(),
        notes=(window.in_words(), *problem.left_out),
    )
