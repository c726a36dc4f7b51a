"""The covariance of held-out residuals is that from which they were drawn."""

import numpy as np
import pytest

from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance
from rfca_rig.diagnosis.reference.matching import find_repeats, name_signals
from rfca_rig.diagnosis.reference.repeats import USUAL_SCATTER, estimate_repeat_error
from tests.diagnosis.reference.observations import ROWS, motion, recording, stack

COMMANDS = 6
REPEATS = 3
# Of a parameter that does not scatter: what so many repeats leave of the usual scatter.
UNSEEN_STD = USUAL_SCATTER / np.sqrt(COMMANDS * (REPEATS - 1))


def make_reference(gain_std, error, seed=4):
    """Rows, residuals and Jacobian where a gain scatters, and a smooth error is in each recording;
    what all repeats share is large.
    """
    random = np.random.default_rng(seed)
    recordings = []
    residuals = []
    slopes = []
    for command in range(COMMANDS):
        course = motion(np.pi * command / COMMANDS)
        shared = 0.2 * random.standard_normal() * np.cos(np.arange(ROWS) / 5.0)
        for repeat in range(REPEATS):
            rows = recording(f"{command} {repeat}", course)
            factor = np.linalg.cholesky(discrepancy_covariance(rows))
            smooth = error * factor @ random.standard_normal(ROWS)
            noise = rows.noise * random.standard_normal(ROWS)
            residuals.append(shared + gain_std * random.standard_normal() * course + smooth + noise)
            slopes.append(course)
            recordings.append(rows)
    return stack(*recordings), np.concatenate(residuals), np.concatenate(slopes)[:, None]


@pytest.mark.parametrize(("gain_std", "error"), [(0.05, 0.002), (0.002, 0.02)])
def test_scatter_and_smooth_error_are_told_apart(gain_std, error):
    rows, residuals, jacobian = make_reference(gain_std, error)
    found = estimate_repeat_error(rows, residuals, jacobian, find_repeats(rows, name_signals))
    assert found.spare == COMMANDS * (REPEATS - 1)
    assert found.error == pytest.approx(error, rel=0.6)
    if gain_std > error:
        assert found.std[0] == pytest.approx(gain_std, rel=0.6)
    else:
        assert found.std[0] < 2.0 * UNSEEN_STD


def test_what_all_repeats_share_is_no_difference():
    rows, residuals, jacobian = make_reference(0.0, 0.0)
    found = estimate_repeat_error(rows, residuals, jacobian, find_repeats(rows, name_signals))
    assert found.error < 0.002
    assert found.std[0] < 2.0 * UNSEEN_STD


def test_without_repeats_nothing_is_known():
    rows = stack(recording("a", motion()), recording("b", motion(1.6)))
    assert estimate_repeat_error(rows, np.zeros(80), np.zeros((80, 1)), ()) is None
