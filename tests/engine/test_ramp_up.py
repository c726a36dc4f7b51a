"""What first strokes foretell, against closed forms."""

from dataclasses import replace

import pytest

from rfca_rig.engine.run import RampUp
from rfca_rig.errors import Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Approach, Flap
from tests.engine.test_trips import LIMITS

HALF, MORE = (Approach(0.215, share * 4.0, 4.0, 0.05, 3.5) for share in (0.5, 0.75))
FULL = Flap(0.215, 4.0, 1, 0.05, 3.5)


def energy(speed_rad_s, offset_N=20.0):
    """A force that grows with the square of the speed."""
    return Load(offset_N + 10.0 * speed_rad_s**2, 1.0)


def test_a_force_that_goes_with_the_square_is_foretold_exactly():
    approaches = RampUp(LIMITS, {})
    approaches.take(HALF, energy(2.0))
    approaches.take(MORE, energy(3.0))
    assert approaches.predict_full_speed(MORE, energy(3.0)).force_N == pytest.approx(
        energy(4.0).force_N
    )


def test_the_model_s_proportion_counts_where_it_is_larger():
    expected = {HALF: Load(30.0, 3.0), MORE: Load(40.0, 4.0), FULL: Load(80.0, 6.0)}
    approaches = RampUp(LIMITS, expected)
    approaches.take(HALF, Load(33.0, 3.0))
    assert approaches.predict_full_speed(HALF, Load(33.0, 3.0)).force_N == pytest.approx(
        33.0 * 80.0 / 30.0
    )
    assert approaches.predict_full_speed(HALF, Load(33.0, 3.0)).torque_Nm == pytest.approx(6.0)


def test_it_never_foretells_less_than_was_felt():
    approaches = RampUp(LIMITS, {HALF: Load(60.0, 6.0), FULL: Load(30.0, 3.0)})
    approaches.take(HALF, Load(50.0, 5.0))
    approaches.take(MORE, Load(45.0, 4.0))
    assert approaches.predict_full_speed(MORE, Load(45.0, 4.0)) == Load(45.0, 4.0)


@pytest.mark.parametrize(("limit_N", "goes_on"), [(281.0, True), (279.0, False)])
def test_full_speed_is_not_run_where_it_would_pass_the_limit(limit_N, goes_on):
    approaches = RampUp(replace(LIMITS, force_N=limit_N), {})
    approaches.take(HALF, energy(2.0, 120.0))
    if goes_on:
        approaches.take(MORE, energy(3.0, 120.0))
        return
    with pytest.raises(Tripped, match=r"brought 210 N and 1\.0 N m, which predicts 280 N") as found:
        approaches.take(MORE, energy(3.0, 120.0))
    assert found.value.code == Trip.FULL_SPEED_TOO_MUCH


def test_conditions_do_not_speak_for_one_another():
    approaches = RampUp(LIMITS, {})
    approaches.take(HALF, energy(2.0))
    elsewhere = replace(MORE, height_m=0.235)
    assert approaches.predict_full_speed(elsewhere, Load(5.0, 0.5)) == Load(5.0, 0.5)
