"""Effects in the hinges against closed forms. One link swings, weightless, on another that is
held: I phi'' = - torque.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import advance, allocate_samples
from rfca_rig.model.parameters import Ground
from rfca_rig.model.stroke import simulate_stroke, simulate_stroke_at_speed
from tests.model.effects.rigs import NO_GROUND_M, TIGHT, having, held, released, resting, through
from tests.model.legs import PAPER, pendulum

INERTIA = 0.4 * 0.5**2 / 3
K0 = 2.0
SPRUNG = pendulum(2, k0=K0)
PERIOD_S = 2 * np.pi * np.sqrt(INERTIA / K0)


def bent(samples):
    return samples.q[:, 1] - samples.q[:, 0]


def moments_beyond(state):
    """Moment of the weight about every hinge of the paper's leg, and the bend there."""
    lengths = np.array(PAPER.leg.link_lengths_m)
    masses = np.array(PAPER.leg.link_masses_kg)
    places = np.cumsum(lengths * np.cos(state.q))
    centres = places - 0.5 * lengths * np.cos(state.q)
    return np.array(
        [(9.81 * masses[i:] * (centres[i:] - places[i - 1])).sum() for i in range(1, 7)]
    ), np.diff(state.q)


def spring(phi):
    return 10.98 * (phi + 4.56 * phi**3)


def test_dry_friction_takes_twice_its_torque_over_k_off_each_swing():
    friction = 0.05
    start = 0.5
    t = np.arange(1, 1700) * 1e-3
    phi = bent(
        released(having(SPRUNG, hinge_coulomb_friction={"torque_Nm": friction}), [0.0, start], t)
    )
    for swings in (1, 2, 3, 4):
        peak = np.interp(swings * PERIOD_S / 2, t, phi)
        assert peak == pytest.approx(
            (-1) ** swings * (start - 2 * swings * friction / K0), abs=2e-3
        )


def loop_area(law, memory, amplitude, steps):
    """Work taken per cycle between -amplitude and +amplitude, the second time round."""
    way = np.concatenate(
        [np.linspace(-amplitude, amplitude, steps), np.linspace(amplitude, -amplitude, steps)]
    )
    work = 0.0
    for turn in range(2):
        for before, phi in zip(np.roll(way, 1), way, strict=True):
            start = law.law(before, 0.0, 0.0, K0, 0.0, memory, law.parameters)[0]
            end = law.law(phi, 0.0, 1.0 / steps, K0, 0.0, memory, law.parameters)[0]
            law.advance(phi, 0.0, 1.0 / steps, K0, 0.0, memory, law.parameters)
            work += turn * 0.5 * (start + end) * (phi - before)
    return work


def only_law(**effects):
    (law,) = set_up(having(SPRUNG, **effects), NO_GROUND_M, held(0.0)).laws
    return law


def test_dry_friction_takes_four_times_torque_and_amplitude_per_cycle():
    law = only_law(hinge_coulomb_friction={"torque_Nm": 0.05})
    assert loop_area(law, [0.0] * 4, 0.5, 4000) == pytest.approx(4 * 0.05 * 0.5, rel=3e-3)


@pytest.mark.parametrize("steps", [500, 5000])
def test_the_hysteresis_loop_has_its_closed_form_s_area_at_any_speed(steps):
    strength = 0.3
    saturation = np.radians(4.0)
    amplitude = 0.2
    law = only_law(spring_hysteresis={"strength_relative": strength, "saturation_deg": 4.0})
    area = (
        4 * strength * K0 * saturation * (amplitude - saturation * np.tanh(amplitude / saturation))
    )
    assert loop_area(law, [0.0] * 4, amplitude, steps) == pytest.approx(area, rel=1e-3)


def test_hysteresis_takes_its_work_out_of_the_swing():
    strength = 0.1
    saturation = np.radians(4.0)
    start = 0.5
    effect = {"strength_relative": strength, "saturation_deg": 4.0}
    t = np.arange(1, 800) * 1e-3
    phi = bent(released(having(SPRUNG, spring_hysteresis=effect), [0.0, start], t))
    low = phi.min()
    full = strength * K0 * saturation
    taken = -full * (low - start) - 2 * full * saturation * (
        1.0 - np.exp((low - start) / saturation)
    )  # z from 1 to -1 on the way down
    assert 0.5 * K0 * (start**2 - low**2) == pytest.approx(taken, rel=2e-3)


def test_dry_friction_below_its_torque_holds_a_link_where_it_is():
    rig = having(pendulum(2, k0=1e-6), hinge_coulomb_friction={"torque_Nm": 1.0})
    weight = 0.4 * 9.81 * 0.25
    assert weight < 1.0
    _, state = resting(rig, 0.0)
    assert state.q[1] == pytest.approx(weight * 1e-3, rel=1e-3)
    assert released(rig, list(state.q), np.array([1.0, 5.0]), gravity=9.81).q[-1] == pytest.approx(
        state.q, abs=1e-9
    )


def test_a_stuck_pin_comes_to_rest_instead_of_ringing():
    friction = 4.0
    weight = 0.4 * 9.81 * 0.25
    rig = having(pendulum(2, k0=1e-6), hinge_coulomb_friction={"torque_Nm": friction})
    t = np.arange(1, 400) * 1e-3
    phi = bent(released(rig, [0.0, 0.0], t, gravity=9.81))
    rest = weight * 1e-3 / friction
    assert phi.max() > 1.3 * rest  # it did ring,
    assert np.abs(phi[t > 0.25] / rest - 1.0).max() < 0.02  # and does no more


def test_laws_with_memory_keep_apart():
    t = np.linspace(0.01, 0.5, 50)
    friction = {"hinge_coulomb_friction": {"torque_Nm": 0.05}}
    silent = {"spring_relaxation": {"strength_relative": 0.0, "time_constant_s": 0.1}}
    rig = pendulum(3, k0=K0)
    start = [0.0, 0.3, -0.2]
    alone, beside = (
        released(having(rig, **effects), start, t).q for effects in (friction, silent | friction)
    )
    assert beside == pytest.approx(alone, abs=1e-12)


def test_a_leg_pressed_and_held_relaxes_with_the_time_constant():
    """A hard, smooth floor keeps the bend, so the force is the springs' torque over a fixed arm:
    1 + s exp(-t / tau).
    """
    strength = 0.4
    tau = 0.3
    rig = replace(
        pendulum(2, 0.2, 0.02, k0=5.0, hinge_damping=0.002), ground=Ground(1e9, 1.0, 0.0, 3e4, 0.0)
    )
    rig = having(rig, spring_relaxation={"strength_relative": strength, "time_constant_s": tau})
    t = np.linspace(0.2, 4.0, 39)
    normal = simulate_stroke(rig, 0.25, through([0.0, 0.02, 9.0], [0.3, 1.0, 1.0]), t).normal_N[
        :, -1
    ]
    left = normal - normal[-1]
    early = t < 1.2
    assert np.polyfit(t[early], np.log(left[early]), 1)[0] == pytest.approx(-1.0 / tau, rel=1e-2)
    weight_share = 0.02 * 9.81 / 2
    expected = (
        strength * np.exp(-t[0] / tau) * np.exp(0.015 / tau)
    )  # the bend grew about 15 ms after the start
    assert left[0] / (normal[-1] - weight_share) == pytest.approx(expected, rel=5e-2)


def test_with_play_a_hinge_rests_where_spring_beyond_the_gap_carries_the_weight():
    gap = np.radians(1.0)
    _, state = resting(having(PAPER, hinge_backlash={"half_gap_deg": 1.0}), 0.3)
    moment, phi = moments_beyond(state)
    assert (phi > gap - 1e-12).all()
    assert spring(phi - gap) == pytest.approx(moment, abs=1e-9)


def test_beyond_its_stop_a_hinge_has_the_stop_s_spring_too():
    stop = np.radians(0.5)
    _, state = resting(
        having(PAPER, hinge_stop={"angle_deg": 0.5, "stiffness_Nm_per_rad": 100.0}), 0.3
    )
    moment, phi = moments_beyond(state)
    assert (phi > stop).any()
    assert (phi < stop).any()
    assert spring(phi) + 100.0 * np.maximum(phi - stop, 0.0) == pytest.approx(moment, abs=1e-9)


@pytest.mark.parametrize("hinge", [2, 7])
def test_a_damaged_hinge_bends_more_by_its_factor_and_no_other(hinge):
    _, state = resting(
        having(PAPER, damaged_hinge={"hinge": float(hinge), "stiffness_factor": 0.5}), 0.3
    )
    moment, phi = moments_beyond(state)
    factor = np.ones(6)
    factor[hinge - 2] = 0.5
    assert factor * spring(phi) == pytest.approx(moment, abs=1e-9)


def test_the_other_hardening_replaces_the_believed_one():
    _, state = resting(having(PAPER, stiffness_hardening={"k2_per_rad2": 0.0}), 0.3)
    moment, phi = moments_beyond(state)
    assert 10.98 * phi == pytest.approx(moment, abs=1e-9)


def test_more_viscous_damping_rings_down_faster():
    c = 0.01
    t = np.linspace(0.001, 0.9, 900)
    phi = bent(
        released(
            having(SPRUNG, hinge_viscous_damping={"coefficient_Nm_s_per_rad": c}), [0.0, 0.01], t
        )
    )
    decay = c / (2 * INERTIA)
    rate = np.sqrt(K0 / INERTIA)
    own = np.sqrt(rate**2 - decay**2)
    assert phi == pytest.approx(
        0.01 * np.exp(-decay * t) * (np.cos(own * t) + decay / own * np.sin(own * t)), abs=2e-6
    )


def test_quadratic_damping_takes_its_work_out_of_each_swing():
    """With b = 2 c / I, the ends A and B of a swing obey (1 - b B) exp(b B) = (1 + b A) exp(-b
    A): the energy less the work of c phi'^2.
    """
    c = 0.02
    start = 0.5
    t = np.arange(1, 1700) * 1e-3
    phi = bent(
        released(
            having(SPRUNG, hinge_quadratic_damping={"coefficient_Nm_s2_per_rad2": c}),
            [0.0, start],
            t,
        )
    )
    b = 2 * c / INERTIA
    end = start
    turns = np.flatnonzero(np.diff(np.sign(np.diff(phi)))) + 1
    for turn in turns[:3]:
        expected = brentq(
            lambda x, a=end: (1 - b * x) * np.exp(b * x) - (1 + b * a) * np.exp(-b * a), 0.0, end
        )
        assert abs(phi[turn]) == pytest.approx(expected, abs=2e-6)
        end = expected
    assert end < 0.8 * start


@pytest.mark.parametrize("let_go", [0.0, 1.0, 2.0])
def test_a_leg_rests_where_its_pins_were_left_and_stays_there(let_go):
    """Bent slowly from straight they hold it up by their torque, let go they bear nothing, after
    swinging they may hold it down.
    """
    free_bent_rad = bent_at_rest({})
    bent_rad = bent_at_rest({"hinge_coulomb_friction": {"torque_Nm": 0.005, "let_go": let_go}})
    assert np.sign(free_bent_rad - bent_rad).tolist() == [1.0 - let_go] * 6
    if let_go == 1.0:
        assert bent_rad == pytest.approx(free_bent_rad, abs=1e-12)
    else:
        assert bent_rad[0] - free_bent_rad[0] == pytest.approx(
            (let_go - 1.0) * 0.005 / PAPER.leg.k0_Nm_per_rad, rel=0.04
        )  # the bend also shifts the weight


def bent_at_rest(effects):
    rig = having(PAPER, **effects)
    setup, state = resting(rig, 0.2)
    rest = np.diff(state.q)
    chain = setup.chain()
    samples = allocate_samples(np.array([0.05, 0.5]), state.q.size)
    advance(
        chain,
        setup.motion.shaft(),
        state,
        (0.0, 0.5),
        1e-4,
        TIGHT,
        samples,
        setup.compile_laws(chain),
    )
    assert np.diff(samples.q[-1]) == pytest.approx(rest, abs=2e-6)
    return rest


@pytest.mark.parametrize(
    ("before", "factor"), [((), 1.0), ((0,), 1.0), ((9,), 0.8), ((99,), 0.64), ((0, 9), 0.9)]
)
def test_a_leg_that_fades_is_a_softer_one_after_ten_strokes_and_again_after_a_hundred(
    before, factor
):
    t = np.arange(0, 660, 5) * 1e-3
    fading = having(PAPER, stiffness_fading={"loss_per_decade_relative": 0.2})
    softer = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=factor * PAPER.leg.k0_Nm_per_rad))
    found = simulate_stroke_at_speed(fading, 0.215, 2.433, t, strokes_before=before)
    assert found.fz_N == pytest.approx(
        simulate_stroke_at_speed(softer, 0.215, 2.433, t).fz_N, abs=1e-9
    )
