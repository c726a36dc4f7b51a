"""The force over a whole stroke that the model predicts for the commanded motion, with the band
that the uncertainty of the model's values leaves.

The prediction is the one of which a plan states the largest load. The band is a 95 % interval at
each moment: each value in [known_to] is moved up and down by 1.96 standard deviations, and what
raises the force, and what lowers it, add up as independent errors. At a valley this is what
`valley_uncertainty` gives to first order. Where the leg is released, a small shift in time changes
the force by more than its peaks are high; first order would state forces there that no value gives.

The band holds neither the sensor's noise, nor the scatter from stroke to stroke, nor a drive that
lags behind its command.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.fitting.residuals import StrokeMotion
from rfca_rig.analysis.repeats import STDS_OF_95
from rfca_rig.bench.expectation import SAMPLE_S
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_setup, simulate_stroke_at_speed

Floats = NDArray[np.float64]

CHANNELS = ("fy_N", "fz_N", "tx_Nm")


@dataclass(frozen=True)
class PredictedForce:
    """A stroke at `t_s` (m,) from its commanded start. `values` (m, 3) holds `CHANNELS`. `low` and
    `high` (m, 3) are the ends of the 95 % interval of each; None where no uncertainty is stated.
    """

    t_s: Floats
    values: Floats
    low: Floats | None = None
    high: Floats | None = None


def predict_force(
    rig: RigModel,
    known_to: Mapping[str, float],
    height_m: float,
    speed_rad_s: float,
    duration_s: float,
) -> PredictedForce:
    """Predicts the stroke of a condition from rest.

    Strokes are simulated after each other, by what a plan's check has compiled: nothing else needs
    to be compiled beside a run.

    Parameters
    ----------
    rig
        The nominal model.
    known_to
        One standard deviation of its values, as in the section of that name; may be empty.
    height_m, speed_rad_s
        The condition.
    duration_s
        From the commanded start to the end of the prediction.

    Raises
    ------
    BadInput
        Where `known_to` does not fit the model.
    SimulationFailed
        Where the stroke, or the stroke with another value, cannot be simulated.
    """
    t_s = np.arange(0.0, duration_s, SAMPLE_S)
    values = _channels(simulate_stroke_at_speed(rig, height_m, speed_rad_s, t_s))
    if not any(known_to.values()):
        return PredictedForce(t_s, values)
    prior = make_prior((), ModelPoint(rig), known_to)
    motion = StrokeMotion(height_m, speed_rad_s, None, float(t_s[-1]))
    squares_below = np.zeros_like(values)
    squares_above = np.zeros_like(values)
    for step in STDS_OF_95 * np.eye(len(prior.std)):
        changes = [_simulate(motion, prior.at(sign * step), t_s) - values for sign in (1.0, -1.0)]
        squares_below += np.minimum(np.minimum(*changes), 0.0) ** 2
        squares_above += np.maximum(np.maximum(*changes), 0.0) ** 2
    low = values - np.sqrt(squares_below)
    high = values + np.sqrt(squares_above)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise SimulationFailed("the model's values times their uncertainty give no numbers")
    return PredictedForce(t_s, values, low, high)


def _simulate(motion: StrokeMotion, point: ModelPoint, t_s: Floats) -> Floats:
    job = replace(motion.job(point), t_s=t_s)
    return _channels(simulate_setup(job.setup(), job.t_s, only_sensed=True))


def _channels(stroke: SimulatedStroke) -> Floats:
    """(m, 3) in the order of `CHANNELS`."""
    return np.column_stack([getattr(stroke, name) for name in CHANNELS])
