"""Decoys: what no physics does. An effect that explains no more than the best of them is preferred for its shape, not for its sense.

Each is the signature of an effect of the catalogue with one channel turned about, as if a spring that presses harder were felt as a
lighter one. Searched as the effects are, they show what so many tries come to by chance and by whatever else the model lacks (the idea
is that of target and decoy in spectrometry: Elias and Gygi, Nature Methods 4 (2007) 207).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.screening import projection_of
from rfca_rig.diagnosis.likelihood.laplace import laplace_posterior

Floats = NDArray[np.float64]

ALIKE = 0.8  # cosine from which on a decoy says what the effect says: one channel alone carries both


def best_decoy(found: ModelSelectionResult, best: Hypothesis, simpler: Hypothesis) -> float:
    """chi2 at a usual model error that the best decoy takes from what the simpler hypothesis leaves."""
    projection = projection_of(simpler.fitted, found.evidence.rows.measured, found.judge.usual)
    explained = _normed(projection.through(projection.whitening(best.rows - simpler.rows)))
    gains = [0.0]
    for decoy in _decoys(found):
        white = projection.whitening(decoy)
        inside = projection.through(white)
        if abs(float(explained @ _normed(inside))) < ALIKE:
            gains.append(projection.gain_inside(white, inside)[0])
    return max(gains)


def taken_away(found: ModelSelectionResult, best: Hypothesis, simpler: Hypothesis) -> float:
    """chi2, prior's share included, by which the best leaves less than the simpler one."""
    measured, usual = found.evidence.rows.measured, found.judge.usual
    before, after = (laplace_posterior(h.fitted.linear(measured), usual) for h in (simpler, best))
    return before.chi2 + float(before.mean @ before.mean) - after.chi2 - float(after.mean @ after.mean)


def _normed(rows: Floats) -> Floats:
    return np.asarray(rows / max(float(np.linalg.norm(rows)), 1e-300))


def _decoys(found: ModelSelectionResult) -> Iterator[Floats]:
    signal = found.evidence.rows.signal
    for channel in ("fy_N", "fz_N", "tx_Nm"):
        turned = np.where(signal == channel, -1.0, 1.0)
        if np.any(turned < 0.0) and np.any(turned > 0.0):
            yield from (turned * trial.signature for trial in found.trials)
