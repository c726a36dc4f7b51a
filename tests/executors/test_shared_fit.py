"""A fit whose starts are shared out."""

import numpy as np
import pytest

from rfca_rig.analysis.fitting.fit import Search
from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.strokes import ValleyRow, fit_valleys
from rfca_rig.analysis.phases import find_valley
from rfca_rig.executors.mapping import process_executor
from rfca_rig.model.stroke import simulate_strokes
from tests.model.legs import PAPER

CONDITIONS = ((0.215, 2.433), (0.235, 3.276))


def stronger(height_m: float, speed_rad_s: float) -> ValleyRow:
    """A valley that is a little deeper than the model's."""
    (stroke,) = simulate_strokes(
        [ValleyRow(height_m, speed_rad_s, 1.1, -50.0, 0.01, 0.1).job(ModelPoint(PAPER))]
    )
    valley = find_valley(stroke.t_s, stroke.fz_N)
    return ValleyRow(height_m, speed_rad_s, valley.time_s, 1.03 * valley.fz_N, 0.01, 0.1)


@pytest.mark.slow
def test_a_fit_has_the_same_bits_wherever_its_starts_are_computed():
    rows = [stronger(*condition) for condition in CONDITIONS]

    def fitted(hands):
        search = Search(starts=2, rng=np.random.default_rng(1), most_evaluations=2, executor=hands)
        return fit_valleys(PAPER, rows, ("k0", "friction"), {}, search)

    alone = fitted(None)
    with process_executor(2) as two:
        shared = fitted(two)
    assert (
        shared.x.tobytes() == alone.x.tobytes()
        and shared.covariance.tobytes() == alone.covariance.tobytes()
    )
    assert (shared.starts, shared.evaluations) == (alone.starts, alone.evaluations)
