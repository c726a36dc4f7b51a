"""The drift of a leg's stiffness, against closed forms."""

import numpy as np
import pytest

from rfca_rig.analysis.static_forces import stiffness_drift
from rfca_rig.recording.model import StaticStage

FIRST = ((4.0, -9.0), (8.0, -20.0), (12.0, -35.0))


def stages(*checks):
    """Static stages of checks, each a list of (fy, fz)."""
    forces = [force for check in checks for force in check]
    return [
        StaticStage(0.2, number, "loading", 1.0, (0.0,) * 6, fy, fz, 0.0)
        for number, (fy, fz) in enumerate(forces, start=1)
    ]


def scaled(factor):
    return [(factor * fy, factor * fz) for fy, fz in FIRST]


def test_a_softer_leg_drifts_by_as_much_as_it_is_softer():
    drift = stiffness_drift(stages(FIRST, scaled(1.01), scaled(0.93)), 3, 3)
    assert (drift.relative, drift.std) == (pytest.approx(-0.07), pytest.approx(0.0, abs=1e-12))


def test_the_standard_error_covers_what_noise_does():
    random = np.random.default_rng(3)
    pulls = []
    for _ in range(400):
        noisy = [tuple(np.array(force) + 0.2 * random.standard_normal(2)) for force in scaled(0.95)]
        drift = stiffness_drift(stages(FIRST, noisy), 3, 2)
        pulls.append((drift.relative + 0.05) / drift.std)
    assert np.mean(np.abs(pulls) < 2.57) == pytest.approx(
        0.95, abs=0.035
    )  # Student's t with 5 degrees of freedom


def test_a_check_that_is_not_whole_says_nothing():
    assert stiffness_drift(stages(FIRST, FIRST[:2]), 3, 2) is None
    assert stiffness_drift(stages(FIRST), 3, 1).relative == 0.0
