"""Noise of recorded signals."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.samples import sample_std, usual_std
from rfca_rig.campaign.experiment import Experiment, MechanismRun

Floats = NDArray[np.float64]


def estimate_noise(run: MechanismRun) -> Floats:
    """Standard deviations (s,) of the least noise of each signal of a recording, from its
    samples.
    """
    if run.noise_factors is None:
        return sample_std(run.signals)
    # At impacts and gaps samples differ by much more, but only in a few of them.
    return usual_std(run.signals, run.noise_factors)


def read_noise(experiment: Experiment, run: MechanismRun) -> Floats:
    """Standard deviations (s,) of the signals of a recording: as stated, or else estimated."""
    stated = [signal.noise_std for signal in experiment.signals]
    estimates = estimate_noise(run)
    return np.array([std or estimate for std, estimate in zip(stated, estimates, strict=True)])
