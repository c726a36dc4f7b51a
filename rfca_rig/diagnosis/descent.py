"""The best point of one hypothesis: damped Gauss-Newton, its slopes renewed only as far as they change.

A hypothesis far from the data is judged by a wide model error, which shrinks as the fit improves: otherwise rows that no value could
explain would drive the nuisances to the ends of their priors.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.coordinates import FARTHEST, Coordinates
from rfca_rig.diagnosis.covariance import AtError, Whitening
from rfca_rig.diagnosis.evidence import Evidence
from rfca_rig.diagnosis.judging import Judge
from rfca_rig.diagnosis.linear import Linear, posterior_of

Floats = NDArray[np.float64]

STEP = 0.1  # of a prior deviation: below, the integrator's own steps show in the slopes
ROUNDS = 6
LEVELS = 5
POLISHED = 4
CONVERGED = 0.3  # of the log evidence
ALIKE = 0.995  # cosine of two slopes in units of noise
GOOD_ENOUGH = 0.02  # of the log posterior density


@dataclass(frozen=True)
class Fitted:
    """A hypothesis at its best point: x (p,), the model's rows there (m,), and its slope (m, p)."""

    coordinates: Coordinates
    x: Floats
    predicted: Floats
    slope: Floats

    def linear(self, measured: Floats) -> Linear:
        """The hypothesis as a linear model."""
        return Linear(measured - self.predicted + self.slope @ self.x, self.slope)


@dataclass(frozen=True)
class Descent:
    """What all descents share."""

    evidence: Evidence
    judge: Judge

    def at(self, coordinates: Coordinates, x: Floats, known_slope: Floats | None = None) -> Fitted | None:
        """The hypothesis at x; None where the model has no answer. The first slopes are taken over from `known_slope`."""
        predicted = self.evidence.predicted(coordinates.supposed(x))
        if predicted is None:
            return None
        left = np.empty((len(predicted), 0)) if known_slope is None else known_slope
        columns = [self._column(coordinates, x, predicted, i) for i in range(left.shape[1], coordinates.size)]
        return Fitted(coordinates, x, predicted, self._aligned(coordinates, np.column_stack([left, *columns])))

    def descended(self, start: Fitted, levels: int = LEVELS, rounds: int = ROUNDS) -> Fitted:
        """From `start` down until nothing more is gained, at one model error after the other."""
        here, last = start, np.inf
        for _ in range(levels):
            whitening = self.judge.level(here.linear(self.evidence.rows.measured))
            here = self._down(here, whitening, rounds)
            if whitening.s == last:
                break
            last = whitening.s
        return here

    def polished(self, found: Fitted, rounds: int = POLISHED) -> Fitted:
        """All slopes anew at the point found, and down once more, until that no longer helps."""
        here, before = found, self._log_evidence(found)
        for _ in range(rounds):
            renewed = self.at(here.coordinates, here.x)
            if renewed is None:
                return here
            here = self.descended(renewed)
            after = self._log_evidence(here)
            if abs(after - before) < CONVERGED:
                break
            before = after
        return here

    def _log_evidence(self, fitted: Fitted) -> float:
        return self.judge.judged(fitted.linear(self.evidence.rows.measured)).log_evidence

    def _down(self, here: Fitted, whitening: AtError, rounds: int) -> Fitted:
        for _ in range(rounds):
            there = self._stepped(here, whitening)
            if there is None:
                return here
            gained = self._misfit(here.x, here.predicted, whitening) - self._misfit(there.x, there.predicted, whitening)
            here = there
            if gained < GOOD_ENOUGH:
                return here
        return here

    def _misfit(self, x: Floats, predicted: Floats, whitening: Whitening) -> float:
        """Minus the log posterior density at x, but for a constant."""
        rest = whitening(self.evidence.rows.measured - predicted)
        return 0.5 * float(rest @ rest + x @ x)

    def _stepped(self, here: Fitted, whitening: Whitening) -> Fitted | None:
        goal = _goal(here.linear(self.evidence.rows.measured), whitening)
        before = self._misfit(here.x, here.predicted, whitening)
        if before - self._misfit(goal, here.predicted + here.slope @ (goal - here.x), whitening) < GOOD_ENOUGH:
            return None
        for share in (1.0, 0.5, 0.2, 0.05):
            x = here.x + share * (goal - here.x)
            predicted = self.evidence.predicted(here.coordinates.supposed(x))
            if predicted is not None and self._misfit(x, predicted, whitening) < before:
                return self._renewed(here, x, predicted)
        return None

    def _renewed(self, here: Fitted, x: Floats, predicted: Floats) -> Fitted:
        """Broyden's update of all slopes, then those of the effects' parameters by differences."""
        step = x - here.x
        surprise = predicted - here.predicted - here.slope @ step
        slope = here.slope + np.outer(surprise, step / max(float(step @ step), 1e-12))
        for i in range(here.coordinates.nuisances, here.coordinates.size):
            slope[:, i] = self._column(here.coordinates, x, predicted, i)
        return replace(here, x=x, predicted=predicted, slope=self._aligned(here.coordinates, slope))

    def _aligned(self, coordinates: Coordinates, slope: Floats) -> Floats:
        """Nuisances that do all but the same as an effect, as a rack's height, made to do just the same.

        Their slopes are differences over other steps; the data must not seem to tell apart what only the prior does.
        """
        size = slope / self.evidence.rows.noise[:, None]
        norm = np.maximum(np.linalg.norm(size, axis=0), 1e-300)
        for effect in range(coordinates.nuisances, coordinates.size):
            for nuisance in range(coordinates.nuisances):
                alike = float(size[:, effect] @ size[:, nuisance]) / (norm[effect] * norm[nuisance])
                if abs(alike) > ALIKE:
                    slope[:, nuisance] = slope[:, effect] * alike * norm[nuisance] / norm[effect]
        return slope

    def _column(self, coordinates: Coordinates, x: Floats, predicted: Floats, i: int) -> Floats:
        """One slope by a difference towards the middle of the prior; zero where the model has no answer on either side."""
        for step in (-STEP if x[i] > 0.0 else STEP, STEP if x[i] > 0.0 else -STEP):
            moved = x.copy()
            moved[i] += step
            there = self.evidence.predicted(coordinates.supposed(moved))
            if there is not None:
                return np.asarray((there - predicted) / step)
        return np.zeros(len(predicted))


def _goal(linear: Linear, whitening: Whitening) -> Floats:
    """The posterior mean within the bounds: what would leave them is held there, and the others found anew."""
    x, free = posterior_of(linear, whitening).mean, np.ones(linear.slope.shape[1], dtype=bool)
    while np.any(np.abs(x[free]) > FARTHEST):
        free &= np.abs(x) <= FARTHEST
        x = np.clip(x, -FARTHEST, FARTHEST)
        if not free.any():
            break
        rest = Linear(linear.target - linear.slope[:, ~free] @ x[~free], linear.slope[:, free])
        x[free] = posterior_of(rest, whitening).mean
    return np.clip(x, -FARTHEST, FARTHEST)
