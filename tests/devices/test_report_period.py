"""A period of reports is refused when it is wrong each time one looks, and only then."""

import pytest

from rfca_rig.drivers.device_time import MAX_ATTEMPTS, find_wrong_period

SET_S = 2e-3


@pytest.mark.parametrize("seen_s", [0.9e-3, 1e-3, 4e-3, 5.4e-3])
def test_a_wrong_period_is_looked_at_again_and_told(seen_s: float) -> None:
    looks = iter([seen_s] * MAX_ATTEMPTS)
    assert find_wrong_period(lambda: next(looks), SET_S) == seen_s
    assert next(looks, None) is None


@pytest.mark.parametrize("at", range(MAX_ATTEMPTS))
def test_one_look_in_which_all_is_well_is_enough(at: int) -> None:
    looks = iter([5.4e-3] * at + [1.9e-3])
    assert find_wrong_period(lambda: next(looks), SET_S) is None
