"""A recorded shaft angle is as late as the recorded force, whatever the beat of drive and loop."""

import can
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from rfca_rig.bench.leg_plant import LegPlant
from rfca_rig.drivers.can_frames import arrival_s
from rfca_rig.engine.run import run_plan
from tests.bench.test_moteus_and_odrive_rigs import MOTEUS, NEWER_ODRIVE, OLDER_ODRIVE
from tests.bench.test_motors import MIT, SERVO, rig_with
from tests.engine.rigs import nothing, one_condition, recorder_on

# The sensor's own records are 1/7000 s apart, and the first of them comes at any time of a period.
FORCE_PERIOD_S = 1.0 / 7000.0


@pytest.fixture
def truth(monkeypatch):
    """True angle and force of the plant over the time of its clock, as lists that fill up."""
    logged = {"t_s": [], "angle_rad": [], "force_t_s": [], "fz_N": []}
    advance = LegPlant.advance

    def log(plant, to_s, drive, force_times_s):
        wrench = advance(plant, to_s, drive, force_times_s)
        logged["t_s"].append(to_s)
        logged["angle_rad"].append(plant.shaft().angle_rad)
        logged["force_t_s"] += list(force_times_s)
        logged["fz_N"] += wrench[:, 2].tolist()
        return wrench

    monkeypatch.setattr(LegPlant, "advance", log)
    return logged


def shift_s(trace, true_t_s, true_values, about_s):
    """What is to be added to the recorded times to get those of the plant."""
    t_s, values = trace
    turning = (t_s > 0.2) & (t_s < 0.75)

    def misfit(shift):
        apart = np.interp(t_s[turning] + shift, true_t_s, true_values) - values[turning]
        return float(np.sum(apart**2))

    around = (about_s - 0.01, about_s + 0.01)
    return minimize_scalar(misfit, bounds=around, method="bounded", options={"xatol": 1e-7}).x


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motor", "tolerance_s"),
    [
        (OLDER_ODRIVE, 2.0 * FORCE_PERIOD_S),
        (NEWER_ODRIVE, 2.0 * FORCE_PERIOD_S),
        (MIT, 2.0 * FORCE_PERIOD_S),
        # Steps of 0.1 degrees take 0.5 ms of the turn.
        (SERVO, 0.6e-3),
        (MOTEUS, 2.0 * FORCE_PERIOD_S),
    ],
    ids=["odrive 0.5", "odrive 0.6", "mit", "servo", "moteus"],
)
def test_angle_and_force_are_recorded_at_the_same_time(tmp_path, truth, motor, tolerance_s):
    rig = rig_with(tmp_path, motor)
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        run_plan(one_condition(rig), bench, recorder, nothing)
    (stroke,) = recorder.strokes
    true_t_s = np.array(truth["t_s"])
    true_rad = np.array(truth["angle_rad"])
    # The motion begins where the shaft, long at rest at its start angle, first turns on.
    angle = stroke.channel("shaft_angle_rad")
    half_turn_rad = np.interp(0.5, *angle)
    began_s = true_t_s[np.flatnonzero(true_rad > half_turn_rad)[0]] - 0.5
    angle_s = shift_s(angle, true_t_s, true_rad, began_s)
    force_s = shift_s(
        stroke.channel("fz_N"), np.array(truth["force_t_s"]), np.array(truth["fz_N"]), began_s
    )
    assert abs(angle_s - force_s) < tolerance_s


def frame(at_s):
    return can.Message(arbitration_id=9, timestamp=at_s)


SYSTEM_S = 1.7e9


@pytest.mark.parametrize(
    ("stamped_s", "arrived_s"),
    [
        # Between the drains at 9.998 and 10.0.
        (SYSTEM_S - 0.0005, 9.9995),
        (SYSTEM_S - 0.0019, 9.9981),
        # Before the last drain, after this one, and by an adapter's own clock.
        (SYSTEM_S - 0.003, 10.0),
        (SYSTEM_S + 0.001, 10.0),
        (12.5, 10.0),
        (0.0, 10.0),
    ],
)
def test_a_stamp_counts_where_it_is_from_the_time_since_the_last_drain(stamped_s, arrived_s):
    found = arrival_s(frame(stamped_s), since_s=9.998, drained_s=10.0, wall_s=SYSTEM_S)
    assert found == pytest.approx(arrived_s, abs=1e-6)
