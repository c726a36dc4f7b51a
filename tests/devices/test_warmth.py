"""The temperature of a twin's motor, against the solution of its law."""

from math import exp

import pytest

from rfca_rig.twins.drive_parts import MotorThermalModel, ThermalParameters

LAW = ThermalParameters(air_degC=25.0, time_constant_s=100.0, rise_K_per_Nm2=0.5)


@pytest.mark.parametrize("step_s", [0.01, 1.0, 50.0])
def test_under_a_steady_torque_it_goes_to_its_end_exponentially_whatever_the_step(
    step_s: float,
) -> None:
    warmth = MotorThermalModel(LAW)
    for _ in range(round(150.0 / step_s)):
        warmth.advance(step_s, -4.0)
    assert warmth.reported_degC == pytest.approx(25.0 + 8.0 * (1.0 - exp(-1.5)), rel=1e-9)


def test_it_cools_when_the_torque_is_gone() -> None:
    warmth = MotorThermalModel(LAW)
    warmth.advance(1e6, 10.0)
    warmth.advance(100.0, 0.0)
    assert warmth.reported_degC == pytest.approx(25.0 + 50.0 * exp(-1.0))


def test_a_fever_warms_by_so_many_kelvin_a_second_at_first() -> None:
    warmth = MotorThermalModel(LAW)
    warmth.fever_K_s = 5.0
    warmth.advance(1.0, 0.0)
    assert warmth.reported_degC == pytest.approx(30.0, abs=0.05)


def test_a_temperature_that_sticks_is_told_again_and_again() -> None:
    warmth = MotorThermalModel(LAW)
    warmth.stick()
    warmth.advance(1e6, 10.0)
    assert warmth.reported_degC == 25.0
