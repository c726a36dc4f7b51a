"""Outputs against closed forms, balances, and other parts of the package that say the same."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.analysis.strips import compare_strips
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import GRAVITY_M_S2, PresentEffect
from rfca_rig.sweep.outputs import OUTPUTS, CaseResults, OutputMissing, parse_output
from rfca_rig.sweep.quantities import SweepCase
from tests.model.legs import PAPER

SMOOTH = replace(
    PAPER,
    leg=replace(PAPER.leg, hinge_damping_Nm_s_per_rad=0.0),
    ground=replace(PAPER.ground, damping_s_per_m=0.0, friction_coefficient=0.0, drag_N_s_per_m=0.0),
)


def case(rig=PAPER, height_m=0.215, speed_rad_s=2.433, turn_deg=200.0, **more) -> CaseResults:
    return CaseResults(SweepCase(rig, height_m, speed_rad_s, float(np.radians(turn_deg)), **more))


def value(name: str, of: CaseResults) -> float:
    return parse_output(name).of(of)


@pytest.fixture(scope="module")
def plain() -> CaseResults:
    return case()


@pytest.mark.parametrize(
    ("turn_deg", "stored"), [(30.0, "in the air"), (110.0, "pressed"), (200.0, "after lift-off")]
)
def test_without_friction_and_damping_the_shaft_s_work_is_what_the_leg_stores(turn_deg, stored):
    smooth = case(SMOOTH, turn_deg=turn_deg)
    assert (smooth.normal_N[-1] > 0.0) == (stored == "pressed")
    assert abs(value("dissipated_J", smooth)) < 2e-3 * value("energy_put_in_J", smooth)
    assert value("hinge_loss_J", smooth) == 0.0


def test_in_the_air_all_that_is_lost_is_lost_in_the_hinges():
    """A leg that swings freely after a brisk start, over the ground."""
    free = case(height_m=0.5, speed_rad_s=8.0)
    assert not free.normal_N.any()
    assert value("dissipated_J", free) == pytest.approx(value("hinge_loss_J", free), rel=2e-3)
    assert value("hinge_loss_J", free) > 0.01


def test_friction_takes_the_rest(plain):
    lost, hinges, energy = (
        value(name, plain) for name in ("dissipated_J", "hinge_loss_J", "energy_J")
    )
    assert 0.0 < hinges < lost and lost == pytest.approx(energy, abs=0.5)
    assert value("energy_put_in_J", plain) >= energy
    assert value("peak_power_W", plain) == pytest.approx(
        2.433 * value("peak_shaft_torque_Nm", plain), rel=1e-6
    )


def momentum_down(of: CaseResults, row: int) -> float:
    return float(of.chain.first_moment @ (np.cos(of.stroke.q_rad[row]) * of.stroke.w_rad_s[row]))


def test_the_impulse_is_weight_less_mount_less_momentum(plain):
    """d(momentum down)/dt = weight - what the ground bears - fz."""
    t_s = plain.stroke.t_s[plain.moving]
    fz = plain.stroke.fz_N[plain.moving]
    weight = PAPER_WEIGHT_N * (t_s[-1] - t_s[0])
    by_balance = (
        weight
        - float(np.trapezoid(fz, t_s))
        - (momentum_down(plain, -1) - momentum_down(plain, plain.moving.start))
    )
    assert value("impulse_Ns", plain) == pytest.approx(by_balance, rel=2e-3)


PAPER_WEIGHT_N = GRAVITY_M_S2 * sum(PAPER.leg.link_masses_kg)


def test_driving_force_and_load_belong_to_one_moment_and_to_the_sensor(plain):
    load = value("load_capacity_N", plain)
    push = value("driving_force_N", plain)
    at = int(np.argmin(np.abs(plain.stroke.fz_N + load)))
    assert (plain.stroke.fz_N[at], plain.stroke.fy_N[at]) == pytest.approx((-load, -push))
    assert load == pytest.approx(-value("valley_fz_N", plain), rel=1e-3)
    assert value("load_capacity_kg", plain) * GRAVITY_M_S2 == pytest.approx(load)
    assert push == pytest.approx(0.5 * load, rel=0.1)
    assert value("driving_impulse_Ns", plain) > 0.0


def test_the_spike_of_touchdown_is_no_load_capacity():
    hard = case(
        replace(PAPER, ground=replace(PAPER.ground, stiffness_N_per_m1p5=3e6)),
        height_m=0.24,
        speed_rad_s=12.0,
    )
    touching = hard.stroke.t_s - hard.stroke.t_s[hard.touchdown]
    spike = -float(hard.stroke.fz_N[(touching >= 0.0) & (touching < 0.03)].min())
    assert value("load_capacity_N", hard) < 0.5 * spike and spike < value("peak_force_N", hard)


def test_the_valley_is_that_of_predict(plain):
    expected = predict_stroke(PAPER, 0.215, 2.433, 200.0).summary()
    for name in ("valley_time_s", "valley_fz_N"):
        assert value(name, plain) == pytest.approx(expected[name], rel=1e-4)
    assert value("touchdown_s", plain) == pytest.approx(expected["touches_from_s"], abs=1.1e-3)
    assert value("peak_force_N", plain) == pytest.approx(expected["peak_force_N"], rel=0.02)


def test_contact_lasts_from_touchdown_to_lift_off(plain):
    touching = plain.stroke.t_s[plain.normal_N > 0.0]
    assert value("contact_time_s", plain) == pytest.approx(touching[-1] - touching[0], rel=0.02)
    assert value("touchdown_s", plain) == touching[0]


def test_at_rest_in_the_air_a_stiff_leg_is_a_lever():
    stiff = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=1e7))
    leg = stiff.leg
    ends = np.cumsum(leg.link_lengths_m)
    moment = GRAVITY_M_S2 * float(
        np.array(leg.link_masses_kg) @ (ends - 0.5 * np.array(leg.link_lengths_m))
    )
    for degrees in (20, 60, 100):
        torque = value(f"static_torque_Nm@{degrees}", case(stiff, height_m=0.5))
        assert torque == pytest.approx(-moment * np.cos(np.radians(degrees)), rel=1e-4, abs=1e-6)
    assert value("static_load_N@60", case(stiff, height_m=0.5)) == pytest.approx(-PAPER_WEIGHT_N)


def test_a_slow_stroke_loads_as_the_same_angle_at_rest():
    slow = case(speed_rad_s=0.05, turn_deg=75.0 - float(np.degrees(PAPER.leg.start_angle_rad)))
    assert value("static_torque_Nm@75", case()) == pytest.approx(
        float(slow.stroke.shaft_torque_Nm[-1]), rel=0.02
    )
    assert value("static_load_N@75", case()) == pytest.approx(
        -float(slow.stroke.fz_N[-1]), rel=0.03
    )


def test_equivalent_stiffness_is_the_slope_of_the_torque(plain):
    def torque(phi):
        return PAPER.leg.k0_Nm_per_rad * (phi + PAPER.leg.k2_per_rad2 * phi**3)

    at = np.radians(20.0)
    step = 1e-5
    slope = (torque(at + step) - torque(at - step)) / (2.0 * step)
    assert value("equivalent_stiffness_Nm_per_rad@20", plain) == pytest.approx(slope, rel=1e-8)
    assert (
        value("equivalent_stiffness_Nm_per_rad@0", plain)
        == value("hinge_k0_Nm_per_rad", plain)
        == 10.98
    )


def test_the_strip_is_that_of_rfca_rig_strip(plain):
    row = next(
        row
        for row in compare_strips(PAPER, 0.215, 2.433).rows
        if (row.material.name, row.thickness_m) == ("CFSP", 0.8e-3)
    )
    shares = [row.strain.share_spread, row.strain.share_concentrated, row.strain.share_torque]
    names = ("strip_used_pct", "strip_used_short_pct", "strip_used_torque_pct")
    assert [value(name, plain) / 100.0 for name in names] == pytest.approx(shares, rel=1e-3)
    assert value("largest_hinge_angle_deg", plain) == pytest.approx(
        np.degrees(row.stroke.largest_angle_rad), rel=1e-3
    )


def test_a_thinner_strip_is_softer_by_the_cube_and_lighter(plain):
    thin = replace(plain.design.strip, thickness_m=0.4e-3)
    rig = case(strip=thin).rig
    assert rig.leg.k0_Nm_per_rad == pytest.approx(10.98 / 8.0)
    assert sum(PAPER.leg.link_masses_kg) - sum(rig.leg.link_masses_kg) == pytest.approx(
        0.5 * plain.design.strip.mass_kg
    )


def test_what_is_not_there_says_why():
    for name, of, why in (
        ("touchdown_s", case(height_m=0.5), "does not touch the ground"),
        ("valley_fz_N", case(height_m=0.5), "no valley: no contact"),
        ("valley_fz_N", case(height_m=0.02), "lies on the ground before it starts"),
        (
            "static_torque_Nm@60",
            case(replace(PAPER, effects=(PresentEffect("tip_mass", (("mass_g", 5.0),)),))),
            "the plain leg only",
        ),
    ):
        with pytest.raises(OutputMissing, match=why):
            value(name, of)


def test_every_output_says_what_it_is():
    for output in OUTPUTS.values():
        assert output.words and output.equation and output.source
        assert np.isfinite(value(output.name + ("@70" if output.at else ""), case())), output.name


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("valley_N", "did you mean valley_fz_N"),
        ("energy_J@60", "takes no angle"),
        ("static_torque_Nm", "needs a shaft angle in degrees, as in static_torque_Nm@60"),
        ("static_torque_Nm@nan", "needs a shaft angle"),
    ],
)
def test_a_wrong_output_is_one_line(text, said):
    with pytest.raises(BadInput, match=said):
        parse_output(text)
