"""The smoothed state at a moment, from samples around it."""

import numpy as np
import pytest

from rfca_rig.analysis.samples import estimate_start, local_polynomial


def bounced(at_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times, positions (m, 2), noise, and the true speed at `at_s`: joint 1 presses on a spring
    of 25 Hz, joint 2 swings at 1 Hz.
    """
    fast = 2.0 * np.pi * 25.0
    slow = 2.0 * np.pi
    t_s = np.arange(-0.2, 0.2, 0.002)
    # Free before 0, in contact until half a period of the spring has passed, free again with the
    # speed turned.
    position = np.where(
        t_s < 0.0, -t_s, np.where(t_s < 0.02, -np.sin(fast * t_s) / fast, t_s - 0.02)
    )
    if at_s < 0.0:
        speed = -1.0
    elif at_s < 0.02:
        speed = float(-np.cos(fast * at_s))
    else:
        speed = 1.0
    noise = np.full(2, 5e-5)
    measured = np.column_stack([position, 0.1 * np.sin(slow * t_s)]) + np.random.default_rng(
        3
    ).normal(0.0, noise, (t_s.size, 2))
    return t_s, measured, noise, speed


@pytest.mark.parametrize("at_s", [-0.03, -0.024, 0.044, 0.05])
def test_the_start_near_an_impact_is_estimated_from_a_narrower_stretch(at_s):
    t_s, measured, noise, speed = bounced(at_s)
    wide = local_polynomial(t_s, measured, at_s)
    _, estimated, _, std = estimate_start(t_s, measured, at_s, noise)
    assert abs(wide.derivative(1)[0] - speed) > 0.03
    assert abs(estimated[0] - speed) < 0.02
    assert abs(estimated[0] - speed) < 4.0 * std[0]
    # The other joint moves smoothly and keeps the widest stretch.
    assert estimated[1] == wide.derivative(1)[1]
