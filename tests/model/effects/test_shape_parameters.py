"""Shape parameters: neutral values give the law as it was, the derivatives are right at others,
and no shape makes energy.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.effect import Effect, Parameter
from tests.model.effects.rigs import having, held, paper_stroke
from tests.model.effects.test_derivatives import (
    ONLY_IN_POSITION,
    ONLY_IN_SPEED,
    WEIGHTS,
    assembled,
    differenced,
)
from tests.model.effects.test_drive_and_sensor_effects import MOTION, commanded
from tests.model.effects.test_strength import FINE, SMALL
from tests.model.legs import PAPER, pendulum

SHAPED = sorted(id_ for id_, effect in catalogue().items() if effect.shape)
MOVED = {
    "hinge_stop": {"angle_deg": 2.0, "stiffness_Nm_per_rad": 20.0, "exponent": 1.7},
    "spring_hysteresis": SMALL["spring_hysteresis"] | {"exponent": 1.8},
    "hinge_coulomb_friction": SMALL["hinge_coulomb_friction"] | {"presliding_deg": 1.0},
    "ground_stribeck": {"rise_relative": 1.0, "speed_m_s": 0.3, "exponent": 1.8},
    "ground_adhesion": {"force_N": 200.0, "reach_mm": 0.7},
    "ground_compliance": {"stiffness_N_per_m1p5": 2e4, "exponent": 1.1},
}
SOFTER = {"ground_stribeck": {"rise_relative": 1.0, "speed_m_s": 0.3, "exponent": 0.5}}


def law_of(**effects):
    (use,) = set_up(having(PAPER, **effects), 0.2, held(0.1)).laws
    return use


@pytest.mark.parametrize("id_", SHAPED)
def test_the_neutral_shape_is_the_law_as_it_is_without_one(id_):
    stated = {parameter.name: parameter.neutral for parameter in catalogue()[id_].shape}
    plain = paper_stroke(FINE, **{id_: SMALL[id_]})
    shaped = paper_stroke(FINE, **{id_: SMALL[id_] | stated})
    assert shaped.fz_N.tobytes() == plain.fz_N.tobytes()
    assert shaped.fy_N.tobytes() == plain.fy_N.tobytes()


@pytest.mark.parametrize(
    ("id_", "parameter"),
    [pytest.param(i, p, id=f"{i} {p.name}") for i in SHAPED for p in catalogue()[i].shape],
)
def test_a_shape_a_little_off_neutral_moves_the_force_a_little_and_one_at_its_ends_runs(
    id_, parameter
):
    near = parameter.neutral + 1e-6 * (parameter.high - parameter.low)
    plain = paper_stroke(FINE, **{id_: SMALL[id_]})
    shaped = paper_stroke(FINE, **{id_: SMALL[id_] | {parameter.name: near}})
    assert np.sqrt(np.mean((shaped.fz_N - plain.fz_N) ** 2)) < 2e-2
    for end in (parameter.low, parameter.high):
        far = paper_stroke(**{id_: SMALL[id_] | {parameter.name: end}})
        assert np.isfinite(far.fz_N).all()
        assert np.abs(far.fz_N - plain.fz_N).max() + np.abs(far.fy_N - plain.fy_N).max() > 1e-4


@pytest.mark.parametrize(
    "effects", [*({id_: values} for id_, values in MOVED.items()), SOFTER], ids=" ".join
)
@pytest.mark.parametrize(
    "weights", [WEIGHTS, ONLY_IN_POSITION, ONLY_IN_SPEED], ids=["together", "position", "speed"]
)
def test_the_derivative_with_a_shape_is_that_of_the_residual(effects, weights):
    exact = assembled(effects, weights)[1]
    assert differenced(effects, weights) == pytest.approx(
        exact, rel=3e-5, abs=1e-6 * np.abs(exact).max()
    )


@pytest.mark.parametrize(
    ("amplitude", "cycles", "phase"), [(0.1, 10.0, -0.2), (0.3, 7.5, 0.5), (0.05, 40.0, 0.37)]
)
def test_a_rippled_shaft_has_its_law_s_speed_at_any_phase(amplitude, cycles, phase):
    def rhs(now, x):
        return commanded(now)[1] * (1 + amplitude * np.cos(cycles * (x - 0.2) + 2 * np.pi * phase))

    t = np.linspace(0.0, 3.0, 301)
    values = {"amplitude_relative": amplitude, "cycles_per_turn": cycles, "phase_cycles": phase}
    ours = set_up(having(pendulum(1), motor_speed_ripple=values), 1.0, MOTION).motion
    other = solve_ivp(rhs, (0.0, 3.0), [0.2], "DOP853", t, rtol=1e-10, atol=1e-11, max_step=0.01).y[
        0
    ]
    assert ours.angle_rad(t) == pytest.approx(other, abs=2e-6)


def test_a_ripple_s_phase_is_periodic():
    t = np.linspace(0.0, 3.0, 301)
    values = {"amplitude_relative": 0.2, "cycles_per_turn": 9.0}
    whole, none = (
        set_up(
            having(PAPER, motor_speed_ripple=values | {"phase_cycles": phase}), 1.0, MOTION
        ).motion.angle_rad(t)
        for phase in (1.0, 0.0)
    )
    assert whole == pytest.approx(none, abs=1e-12)


@pytest.mark.parametrize(
    ("travels", "within"), [(40, 3e-4), (2000, 1e-5)]
)  # Runge-Kutta, and one Taylor step each
@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.7, 3.0])
def test_the_hysteresis_loop_follows_bouc_and_wen(exponent, travels, within):
    saturation = np.radians(4.0)
    use = law_of(
        spring_hysteresis={"strength_relative": 0.3, "saturation_deg": 4.0, "exponent": exponent}
    )
    turn = 0.2
    memory = [0.0] * 4
    z = 0.0
    for end in (turn, -turn, 0.5 * turn):
        begin = memory[1]
        side = np.sign(end - memory[1])

        # dz/dphi = (1 - |z|^n sgn(z phi')) / saturation, turned into the direction of travel
        def along(_, z, side=side):
            return side * (1 - np.sign(side * z) * np.abs(z) ** exponent) / saturation

        z = solve_ivp(along, (0.0, abs(end - begin)), [z], rtol=1e-9, atol=1e-11, max_step=1e-3).y[
            0, -1
        ]
        for phi in np.linspace(begin, end, travels)[1:]:
            use.advance(phi, 0.0, 0.0, 11.0, 0.0, memory, use.parameters)
        assert memory[0] == pytest.approx(z, abs=within)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0, 3.0])
def test_a_loop_around_and_back_takes_work(exponent):
    use = law_of(
        spring_hysteresis={"strength_relative": 0.3, "saturation_deg": 4.0, "exponent": exponent}
    )
    memory = [0.0] * 4
    work = 0.0
    turn = 0.3 * np.sin(np.linspace(0.0, 4.0 * np.pi, 4001)) * np.linspace(1.0, 0.3, 4001)
    for before, phi in pairwise(turn):
        torque = use.law(0.5 * (before + phi), 0.0, 0.0, 11.0, 0.0, memory, use.parameters)[0]
        work += torque * (phi - before)
        use.advance(phi, 0.0, 0.0, 11.0, 0.0, memory, use.parameters)
    assert work > 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.25, 2.0])
def test_a_soft_floor_of_any_exponent_yields_besides_the_contact(exponent):
    use = law_of(ground_compliance={"stiffness_N_per_m1p5": 2e4, "exponent": exponent})
    for depth in (1e-7, 1e-4, 3e-3):
        N = use.law(depth, 0.0, (0.0,) * 4, use.parameters)[0] + use.parameters[2] * depth**1.5
        assert pytest.approx(depth, rel=1e-9) == (N / 1e5) ** (2 / 3) + (20.0 / 2e4) ** (2 / 3) * (
            N / 20.0
        ) ** (1 / exponent)


def test_a_sensor_zeroed_with_the_leg_on_a_leaning_rig_reads_no_weight_along_y():
    angle = {"angle_rad": 0.1}
    weight = PAPER.leg.link_masses_kg
    before = [paper_stroke(gravity_tilt=angle | {"zero_shift_weights": s}) for s in (0.0, -1.0)]
    assert before[0].fy_N[0] == pytest.approx(-sum(weight) * 9.81 * np.sin(0.1), rel=1e-6)
    assert before[1].fy_N[0] == pytest.approx(0.0, abs=1e-6)
    assert before[1].fz_N == pytest.approx(before[0].fz_N, abs=1e-12)
    assert before[1].tx_Nm - before[0].tx_Nm == pytest.approx(
        0.045 * (before[1].fy_N - before[0].fy_N), abs=1e-9
    )


def test_a_shape_parameter_of_another_effect_is_refused():
    with pytest.raises(BadInput, match="hinge_stop: takes angle_deg, stiffness_Nm_per_rad"):
        paper_stroke(hinge_stop=SMALL["hinge_stop"] | {"presliding_deg": 1.0})


def test_a_neutral_value_outside_of_its_range_is_refused():
    with pytest.raises(
        ValueError, match="shape parameter exponent has its neutral value 0 outside of 1 to 2"
    ):
        Effect(
            "e",
            "rig",
            "-",
            "-",
            "-",
            (),
            lambda setup, _: setup,
            shape=(Parameter("exponent", 1.0, 2.0),),
        )
