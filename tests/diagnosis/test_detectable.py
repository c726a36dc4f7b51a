import numpy as np
import pytest

from rfca_rig.diagnosis.detectable import _threshold
from rfca_rig.diagnosis.locating import _holm


def test_a_force_in_proportion_to_size_is_seen_where_its_square_reaches_what_is_needed():
    sizes = np.array([0.1, 1.0, 10.0])
    distance, rising = _threshold(np.column_stack([sizes, 4.0 * sizes**2]), 16.0)
    assert rising
    assert distance == pytest.approx(2.0)


@pytest.mark.parametrize("sizes", [[5.0, 20.0], [0.02, 0.1]])
def test_beyond_what_was_tried_power_goes_on_with_the_square(sizes):
    sizes = np.array(sizes)
    assert _threshold(np.column_stack([sizes, 4.0 * sizes**2]), 16.0)[0] == pytest.approx(2.0)


def test_a_stiffness_shows_the_less_the_larger_it_is():
    stiffness = np.array([10.0, 100.0, 1000.0])
    distance, rising = _threshold(np.column_stack([stiffness, 4e6 / stiffness**2]), 16.0)
    assert not rising
    assert distance == pytest.approx(500.0)


def test_holm_multiplies_the_smallest_chance_by_all_and_never_falls():
    corrected = _holm(np.array([0.04, 0.001, 0.03]))
    assert corrected == pytest.approx([0.06, 0.003, 0.06])
