"""Strokes of the model on a floor with friction, against the equations of docs/model.md written a
second time.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.benchmarks.textbook_stroke import Drive, Sensor, simulate_textbook_stroke
from tests.model.legs import PAPER

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
END_S = 1.338
# Of fy, fz and tx over the whole stroke, at the model's usual tolerance.
WITHIN_PCT = 0.1


def measure_deviation_pct(theirs, effect_id, values, end_s=END_S):
    """rms of fy, fz and tx (3,), as a share of that of the channel."""
    effects = () if effect_id is None else (PresentEffect(effect_id, tuple(values.items())),)
    t_s = np.arange(-20, round(1e3 * end_s) + 1) * 1e-3
    ours = simulate_stroke_at_speed(replace(PAPER, effects=effects), HEIGHT_M, SPEED_RAD_S, t_s)
    moving = t_s > 0.0
    deviations = []
    for name in ("fy_N", "fz_N", "tx_Nm"):
        expected = getattr(theirs, name)
        off = getattr(ours, name)[moving] - expected
        deviations.append(100.0 * np.sqrt(np.mean(off**2) / np.mean(expected**2)))
    return np.array(deviations)


def simulate(**parts):
    return simulate_textbook_stroke(PAPER, HEIGHT_M, SPEED_RAD_S, END_S, **parts)


@pytest.mark.slow
def test_a_plain_stroke():
    assert measure_deviation_pct(simulate(), None, {}).max() < WITHIN_PCT


@pytest.mark.slow
@pytest.mark.parametrize(
    ("torque_Nm", "cycles", "phase"), [(0.245, 19.0, 0.0), (1.0, 40.0, 0.25), (3.0, 19.0, 0.0)]
)
def test_a_motor_that_cogs(torque_Nm, cycles, phase):
    theirs = simulate(drive=Drive(15.0, 300.0, 1e9, torque_Nm, cycles, 2.0 * np.pi * phase))
    values = {"torque_Nm": torque_Nm, "cycles_per_turn": cycles, "phase_cycles": phase}
    assert measure_deviation_pct(theirs, "motor_cogging", values).max() < WITHIN_PCT


@pytest.mark.slow
@pytest.mark.parametrize("limit_Nm", [6.0, 6.8, 7.5])
def test_a_motor_at_the_limit_of_its_torque(limit_Nm):
    theirs = simulate(drive=Drive(50.0, 1000.0, limit_Nm))
    values = {"limit_Nm": limit_Nm}
    assert measure_deviation_pct(theirs, "motor_torque_limit", values).max() < WITHIN_PCT


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequency_Hz", "ratio", "across"),
    [(10.0, 0.02, 1.0), (40.0, 0.06, 1.5), (200.0, 0.005, 1.0)],
)
def test_a_sensor_that_rings(frequency_Hz, ratio, across):
    rate = 2.0 * np.pi * frequency_Hz
    theirs = simulate(sensor=Sensor((across * rate, rate, across * rate), ratio))
    values = {
        "frequency_Hz": frequency_Hz,
        "damping_ratio": ratio,
        "y_frequency_ratio": across,
    }
    assert measure_deviation_pct(theirs, "sensor_ringing", values).max() < WITHIN_PCT
