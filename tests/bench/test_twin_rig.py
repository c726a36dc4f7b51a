"""The twin's mechanics and what the model expects of a plan."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.bench.leg_plant import LegPlant, TwinScatter
from rfca_rig.description.protocol_file import read_static
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.static_stages import StageMoves, simulate_static_stages
from rfca_rig.model.stroke import simulate_stroke
from rfca_rig.protocol.check import check_plan
from rfca_rig.protocol.experiments import static_plan
from rfca_rig.protocol.plan import Hold, MoveShaft
from rfca_rig.twins.world import ShaftDrive
from tests.engine.rigs import ROOT, one_condition, twin_rig
from tests.model.test_stroke import pressed_and_held

NO_SCATTER = TwinScatter()


def plant(scatter=NO_SCATTER):
    rig = twin_rig().model()
    return LegPlant(rig, 0.215, rig.leg.start_angle_rad, 0.01, scatter, np.random.default_rng(0))


def test_behind_a_stiff_drive_the_plant_is_the_model():
    leg = plant()
    felt = []
    times = np.arange(1, 1000) * 1e-3
    speed = float(np.radians(65.9))
    for t_s in times:
        felt.append(
            leg.advance(
                t_s, ShaftDrive(speed_gain_Nm_s_per_rad=1e4, speed_rad_s=speed), np.array([t_s])
            )[0]
        )
    _, motion = pressed_and_held()
    model = simulate_stroke(twin_rig().model(), 0.215, motion, times)
    assert leg.shaft().angle_rad == pytest.approx(model.shaft_angle_rad[-1], abs=1e-3)
    pressing = times > 0.6
    assert np.array(felt)[pressing, 2] == pytest.approx(model.fz_N[pressing], abs=0.05)
    assert np.array(felt)[pressing, 3] == pytest.approx(model.tx_Nm[pressing], abs=0.01)


def test_without_torque_the_leg_falls():
    leg = plant()
    leg.advance(0.1, ShaftDrive(), np.empty(0))
    assert leg.shaft().angle_rad > twin_rig().leg.start_angle_rad + 0.05
    assert leg.shaft().torque_Nm == 0.0


def test_a_hand_on_the_lead_screws_is_not_exact():
    leg = plant(TwinScatter(height_m=1e-4))
    heights = set()
    for _ in range(3):
        leg.set_height(0.235)
        heights.add(leg.height_m)
    assert len(heights) == 3
    assert all(abs(height - 0.235) < 5e-4 for height in heights)


def test_expected_loads_name_every_stroke():
    plan = one_condition(twin_rig(), repeats=2)
    loads = predict_loads(plan, twin_rig().model())
    assert set(loads) == set(plan.flaps)
    assert all(50.0 < load.force_N < 75.0 for load in loads.values())


def test_the_bending_protocol_bends_the_twin_beyond_130_degrees_within_its_limits():
    rig = twin_rig()
    protocol = read_static(ROOT / "protocols" / "bending.toml").static_stages()
    plan = static_plan(protocol, rig.facts())
    expected = predict_loads(plan, rig.model())
    check_plan(plan, expected)
    assert max(load.force_N for load in expected.values()) < 0.5 * plan.limits.force_N
    (height_m,) = protocol.heights_m
    angles_rad = [angle_rad for angle_rad, _ in protocol.angles_rad]
    states = simulate_static_stages(
        rig.model(), height_m, angles_rad, StageMoves(protocol.move_speed_rad_s, 0.05)
    )
    bends_deg = [abs(float(np.degrees(state.q_rad[-1] - state.q_rad[0]))) for state in states]
    assert bends_deg == sorted(bends_deg)
    assert bends_deg[0] < 40.0
    assert sum(bend_deg > 130.0 for bend_deg in bends_deg) == 3
    assert all(state.normal_N.any() for state in states), "the leg stays on the ground"


def test_a_leg_pushed_back_under_load_is_seen_to_wedge_beforehand():
    rig = twin_rig()
    protocol = read_static(ROOT / "protocols" / "static-angle.toml").static_stages()
    plan = static_plan(replace(protocol, heights_m=(0.235,)), rig.facts())
    safe = predict_loads(plan, rig.model())
    assert max(load.force_N for load in safe.values()) < 150.0
    assert {stage for stage in plan.stages if isinstance(stage, Hold)} <= set(safe)
    back = [
        replace(stage, forwards=False) if isinstance(stage, MoveShaft) else stage
        for stage in plan.stages
    ]
    wedged = predict_loads(replace(plan, stages=tuple(back)), rig.model())
    assert max(load.force_N for load in wedged.values()) > 300.0


@pytest.mark.parametrize(
    "effect",
    [
        PresentEffect("sensor_gain", (("factor", 1.1),)),
        PresentEffect("shaft_compliance", (("stiffness_Nm_per_rad", 50.0),)),
        PresentEffect(
            "motor_speed_ripple", (("amplitude_relative", 0.1), ("cycles_per_turn", 8.0))
        ),
    ],
    ids=lambda effect: effect.id,
)
def test_an_effect_that_the_twin_cannot_show_is_refused_not_forgotten(effect):
    rig = replace(twin_rig().model(), effects=(effect,))
    with pytest.raises(BadInput, match="drive and a sensor of its own"):
        LegPlant(rig, 0.215, 0.7, 0.01, NO_SCATTER, np.random.default_rng(0))


def test_an_effect_of_the_leg_is_felt_on_the_twin():
    rig = replace(twin_rig().model(), effects=(PresentEffect("tip_mass", (("mass_g", 50.0),)),))
    leg = LegPlant(rig, 0.235, rig.leg.start_angle_rad, 0.01, NO_SCATTER, np.random.default_rng(0))
    held = ShaftDrive(
        angle_gain_Nm_per_rad=4e4, angle_rad=rig.leg.start_angle_rad, speed_gain_Nm_s_per_rad=4e2
    )
    assert leg.advance(0.2, held, np.array([0.2]))[0, 2] == pytest.approx(0.37 * 9.81, abs=0.05)
