"""The exam's simulator and the package's model, which share no code, agree on what both know."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.exam.nominal_world import (
    BELOW_SHAFT_M,
    LENGTHS_M,
    MASSES_KG,
    RAMP_S,
    START_RAD,
    nominal_world,
)
from rfca_rig.exam.sampled_rig import EFFECTS, with_effect
from rfca_rig.exam.simulator.experiment import (
    HOLD_S,
    LOADING_RAD,
    MOVE_RAD_S,
    RELEASED_S,
    STEP_S,
    plan_stages,
    sense,
    simulate,
    stroke_traces,
)
from rfca_rig.model.parameters import (
    Drive,
    Ground,
    Leg,
    PresentEffect,
    RigModel,
    SensorMount,
    Swing,
)
from rfca_rig.model.static_stages import STILL_AFTER_S, StageMoves, make_stage_motion
from rfca_rig.model.stroke import simulate_stroke, simulate_stroke_at_speed

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
STROKES_BEFORE = 30

VALUES = {
    "hinge_coulomb_friction": {"torque_Nm": 0.1},
    "hinge_viscous_damping": {"coefficient_Nm_s_per_rad": 0.1},
    "hinge_backlash": {"half_gap_deg": 1.2},
    "hinge_stop": {"angle_deg": 18.0, "stiffness_Nm_per_rad": 30.0},
    "spring_hysteresis": {"strength_relative": 0.35, "saturation_deg": 7.0},
    "spring_relaxation": {"strength_relative": 0.3, "time_constant_s": 0.2},
    "damaged_hinge": {"hinge": 4.0, "stiffness_factor": 0.6},
    "stiffness_hardening": {"k2_per_rad2": 6.0},
    "hinge_rest_angle": {"angle_deg": 1.5},
    "hinge_rest_angle_of_one": {"hinge": 4.0, "angle_deg": -4.0},
    "tip_mass": {"mass_g": 30.0},
    "fluid_drag": {"coefficient_N_s2_per_m3": 20.0},
    "ground_stribeck": {"rise_relative": 0.4, "speed_m_s": 0.3},
    "ground_compliance": {"stiffness_N_per_m1p5": 5e4},
    "ground_tilt": {"slope": 0.03},
    "ground_adhesion": {"force_N": 4.0},
    "motor_speed_droop": {"kp_Nm_s_per_rad": 5.0, "ki_Nm_per_rad": 40.0},
    "motor_speed_ripple": {"amplitude_relative": 0.1, "cycles_per_turn": 8.0},
    "shaft_compliance": {"stiffness_Nm_per_rad": 100.0},
    "frame_compliance": {"frequency_Hz": 20.0, "moving_mass_kg": 5.0, "damping_ratio": 0.05},
    "height_offset": {"offset_mm": 2.0},
    "gravity_tilt": {"angle_rad": 0.05},
    "sensor_lag": {"time_constant_s": 0.01},
    "clock_offset": {"offset_s": 0.01},
    "sensor_crosstalk": {"fz_per_fy": 0.05},
    "sensor_drift": {"rate_N_per_s": 1.0},
    "sensor_gain": {"factor": 1.03},
    "hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.05},
    "heavier_link": {"link": 4.0, "mass_factor": 2.0},
    "ground_exponent": {"exponent": 1.0},
    "sensor_saturation": {"limit_N": 40.0},
    "sensor_ringing": {"frequency_Hz": 25.0, "damping_ratio": 0.05},
    "sensor_clock_rate": {"rate_relative": 0.01},
    "shaft_friction": {"torque_Nm": 0.2},
    "shaft_play": {"half_gap_deg": 1.0},
    "motor_torque_limit": {"limit_Nm": 6.8},
    "motor_cogging": {"torque_Nm": 0.5, "cycles_per_turn": 14.0},
    "stiffness_fading": {"loss_per_decade_relative": 0.1},
    "ground_bump": {"height_mm": 3.0, "at_mm": 80.0, "width_mm": 15.0},
    "sensor_crosstalk_matrix": {
        "fz_per_fy": 0.05,
        "fy_per_fz": -0.04,
        "tx_per_fy_mm": 2.0,
        "tx_per_fz_mm": -3.0,
    },
}


def rig(effect: str | None) -> RigModel:
    if effect:
        effects = (PresentEffect(effect, tuple(VALUES[effect].items())),)
    else:
        effects = ()
    leg = Leg(LENGTHS_M, MASSES_KG, 0.003, 11.0, 4.2, 0.05, START_RAD)
    return RigModel(
        leg, Ground(1e5, 1.0, 0.45, 1e-4, 2.0), SensorMount(BELOW_SHAFT_M), Drive(RAMP_S), effects
    )


def both(effect: str | None):
    world = replace(nominal_world(HEIGHT_M), strokes_before=STROKES_BEFORE)
    traces = stroke_traces(
        with_effect(world, effect, VALUES[effect]) if effect else world, SPEED_RAD_S
    )
    fy, fz, tx = sense(with_effect(world, effect, VALUES[effect]) if effect else world, traces)
    model = simulate_stroke_at_speed(
        rig(effect), HEIGHT_M, SPEED_RAD_S, traces.t_s, strokes_before=(STROKES_BEFORE,)
    )
    return traces.t_s, (fy, fz, tx), (model.fy_N, model.fz_N, model.tx_Nm)


def test_every_effect_is_compared():
    assert set(VALUES) == set(EFFECTS)


@pytest.mark.slow
@pytest.mark.parametrize("effect", [None, *EFFECTS])
def test_valley_and_forces_agree(effect):
    t, exam, model = both(effect)
    mine = find_valley(t, exam[1])
    theirs = find_valley(t, model[1])
    if effect == "sensor_saturation":  # its valley is cut off
        assert not isinstance(mine, Valley) and not isinstance(theirs, Valley)
        mine = theirs = find_valley(t, both(None)[1][1])
    assert isinstance(mine, Valley) and isinstance(theirs, Valley)
    stuck = (
        effect == "hinge_coulomb_friction"
    )  # how a pin comes to slip is each one's own; the valley is flat there
    assert mine.fz_N == pytest.approx(theirs.fz_N, rel=1e-3 if stuck else 2e-4)
    assert mine.time_s == pytest.approx(theirs.time_s, abs=1.5e-3 if stuck else 1e-4)
    pressed = (t > 0.5) & (t < theirs.time_s)
    off = [np.sqrt(np.mean((a - b)[pressed] ** 2)) for a, b in zip(exam, model, strict=True)]
    assert off[0] < 0.05 and off[1] < 0.05 and off[2] < 0.01


@pytest.mark.slow
def test_a_frame_that_sways_under_a_sensor_that_carries_a_part_of_it_agrees(monkeypatch):
    """A motor of 0.8 kg above the sensor, on a frame of 20 Hz: its inertia is a part of what the
    sensor feels.
    """
    swaying = {
        "frequency_Hz": 20.0,
        "moving_mass_kg": 2.0,
        "damping_ratio": 0.05,
        "lean_deg": 60.0,
        "mass_on_sensor_share": 0.4,
    }
    monkeypatch.setitem(VALUES, "frame_compliance", VALUES["frame_compliance"] | {"lean_deg": 60.0})
    _, without, _ = both("frame_compliance")
    monkeypatch.setitem(VALUES, "frame_compliance", swaying)
    t, exam, model = both("frame_compliance")
    pressed = t > 0.5
    for mine, theirs, other in zip(exam[:2], model[:2], without[:2], strict=True):
        assert np.sqrt(np.mean((mine - theirs)[pressed] ** 2)) < 0.05
        assert np.abs(mine - other)[pressed].max() > 1.0


def test_static_stages_agree():
    from rfca_rig.exam.simulator.experiment import (
        HOLD_S,
        LOADING_RAD,
        MOVE_RAD_S,
        UNLOADING_RAD,
        static_table,
    )
    from rfca_rig.model.static_stages import StageMoves, simulate_static_stages

    mine = static_table(nominal_world(HEIGHT_M), 215.0, 0.0075, np.random.default_rng(1))
    theirs = simulate_static_stages(
        rig(None), HEIGHT_M, (*LOADING_RAD, *UNLOADING_RAD), StageMoves(MOVE_RAD_S, 0.0075, HOLD_S)
    )
    off = np.array(
        [
            (a.fy_N - b.fy_N, a.fz_N - b.fz_N, 10.0 * (a.tx_Nm - b.tx_Nm))
            for a, b in zip(mine, theirs, strict=True)
        ]
    )
    hinges = np.array(
        [
            np.array(a.hinge_deg) - np.degrees(b.hinge_angles_rad)
            for a, b in zip(mine, theirs, strict=True)
        ]
    )
    assert np.abs(off).max() < 0.25  # what the tip is thrown back by depends on how it sticks
    assert np.abs(hinges).max() < 0.5


def test_an_arm_relaxes_alike_from_stage_to_stage(monkeypatch):
    """On a floor without friction, which would hold the tip as it was thrown back; both legs are
    released straight.
    """
    monkeypatch.setitem(
        VALUES, "spring_relaxation", {"strength_relative": 0.3, "time_constant_s": 2.0}
    )
    smooth = nominal_world(HEIGHT_M)
    smooth = replace(smooth, floor=replace(smooth.floor, mu=0.0))
    knots, read_s = plan_stages(START_RAD, LOADING_RAD, 0.0075)
    creeping = with_effect(smooth, "spring_relaxation", VALUES["spring_relaxation"])
    mine, without = (
        sense(world, simulate(world, knots, read_s, step_s=STEP_S)) for world in (creeping, smooth)
    )
    let_go = replace(
        rig("spring_relaxation"),
        ground=Ground(1e5, 1.0, 0.0, 1e-4, 2.0),
        swing=Swing(-RELEASED_S, 1.0, 0.0),
    )
    motion, _ = make_stage_motion(
        START_RAD, LOADING_RAD, StageMoves(MOVE_RAD_S, 0.0075, HOLD_S - STILL_AFTER_S)
    )
    theirs = simulate_stroke(let_go, HEIGHT_M, motion, read_s)
    assert np.abs(mine[1] - without[1]).max() > 2.0
    assert mine[1] == pytest.approx(theirs.fz_N, abs=5e-3)
    assert mine[2] == pytest.approx(theirs.tx_Nm, abs=1e-3)
