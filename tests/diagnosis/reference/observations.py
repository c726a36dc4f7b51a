"""Observations of made-up recordings of one signal, with residuals that a test knows."""

import numpy as np

from rfca_rig.diagnosis.data import Label, Observations, stack_observations

BIN_S = 0.05
ROWS = 40


def motion(phase_rad=0.0, amplitude=1.0):
    """Values (ROWS,) of a sine over 2 s."""
    return amplitude * np.sin(np.pi * BIN_S * np.arange(ROWS) + phase_rad)


def recording(name, measured, start_s=0.0, noise=0.001):
    """One condition of a recording of its own."""
    count = len(measured)
    t_s = start_s + BIN_S * np.arange(count)
    label = Label("motions", name, "q_position_rad", recording=name)
    return Observations(
        measured=np.asarray(measured, dtype=float),
        noise=np.full(count, noise),
        scale=np.full(count, 1.0),
        transient_scale=np.full(count, 0.05),
        progress=t_s / (3.0 * BIN_S),
        t_s=t_s,
        phase=np.full(count, name),
        label=np.zeros(count, dtype=np.intp),
        condition=np.zeros(count, dtype=np.intp),
        labels=(label,),
    )


def stack(*recordings):
    """All recordings as one dataset's rows."""
    return stack_observations(list(recordings))
