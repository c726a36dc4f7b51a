"""Swings cut into windows: the problem that a diagnosis solves, on simulated and on real
pendulums.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from rfca_rig.analysis.swings import (
    Nuisance,
    apply_nuisances,
    estimate_start,
    local_polynomial,
    make_swing_problem,
)
from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun, read_pendulum_campaign
from rfca_rig.errors import BadInput
from rfca_rig.model.effects.joint_torques import torque_trace
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, PendulumLink, make_driven_pendulum

DATA = Path(__file__).parents[1] / "data" / "dfki-pendulum"
BELIEVED = Pendulum(
    (PendulumLink(0.2, 0.6, 0.18, 0.022, 0.004), PendulumLink(0.3, 0.55, 0.25, 0.038, 0.002))
)
ANGLE_NOISE = 1e-3
SPEED_NOISE = 0.02
MET = 2.5  # rows of a window share the uncertainty of its start, so that their mean square scatters


def having(**effects: dict[str, float]) -> tuple[PresentEffect, ...]:
    return tuple(PresentEffect(id_, tuple(values.items())) for id_, values in effects.items())


def recorded(
    seed: int, nuisances: dict[str, float], effects: tuple[PresentEffect, ...]
) -> PendulumRun:
    random = np.random.default_rng(seed)
    t_s = np.arange(0.0, 4.0, 0.004)
    torque = np.column_stack([0.7 * np.sin(5 * t_s + seed), 0.3 * np.sin(7 * t_s)])
    after = make_driven_pendulum(apply_nuisances(BELIEVED, nuisances), effects).swing(
        torque_trace(t_s, torque), np.array([0.5, 0.2]), np.zeros(2), t_s[1:]
    )
    angle = np.vstack([[[0.5, 0.2]], after.angle_rad])
    speed = np.vstack([np.zeros((1, 2)), after.speed_rad_s])
    noisy = (
        angle + random.normal(0, ANGLE_NOISE, angle.shape),
        speed + random.normal(0, SPEED_NOISE, speed.shape),
    )
    return PendulumRun(f"seed {seed}, repeat 1", f"seed {seed}", 1, t_s, *noisy, torque)


def campaign(
    nuisances: dict[str, float] | None = None, **effects: dict[str, float]
) -> PendulumCampaign:
    runs = tuple(recorded(seed, nuisances or {}, having(**effects)) for seed in (1, 2))
    known_to = {"mass_relative": 0.05, "torque_offset_Nm": 0.02}
    return PendulumCampaign(
        "simulated",
        BELIEVED,
        known_to,
        {"angle_rad": ANGLE_NOISE, "speed_rad_s": SPEED_NOISE},
        runs,
    )


def normalised(problem, nuisances=None, **effects):
    return (
        problem.predicted(nuisances or {}, having(**effects)) - problem.measured
    ) / problem.noise_std


def chi2(problem, nuisances=None, **effects):
    return float(np.mean(normalised(problem, nuisances, **effects) ** 2))


def test_rows_say_which_run_signal_and_moment_they_are():
    problem = make_swing_problem(campaign())
    m = problem.measured.size
    assert m == 2 * 7 * 4 * 25
    rows = (
        problem.noise_std,
        problem.groups,
        problem.windows_of_row,
        problem.signal_of_row,
        problem.t_s,
        problem.predicted({}),
    )
    assert all(row.shape == (m,) for row in rows)
    assert problem.conditions == ("seed 1, repeat 1", "seed 2, repeat 1")
    assert problem.signals == ("angle1_rad", "angle2_rad", "speed1_rad_s", "speed2_rad_s")
    run = recorded(2, {}, ())
    for signal, samples in enumerate([*run.angle_rad.T, *run.speed_rad_s.T]):
        mine = (problem.groups == 1) & (problem.signal_of_row == signal)
        assert problem.measured[mine] == pytest.approx(
            np.interp(problem.t_s[mine], run.t_s, samples), abs=(0.02, 0.5)[signal > 1]
        )


def test_nothing_left_out_leaves_noise_and_no_more_than_is_stated():
    assert 0.3 < chi2(make_swing_problem(campaign())) < MET


@pytest.mark.parametrize(
    "nuisance", [{"link1.mass_relative": 0.1}, {"link2.torque_offset_Nm": 0.1}]
)
def test_a_believed_value_that_is_off_shows_and_is_allowed_for(nuisance):
    problem = make_swing_problem(campaign(nuisance))
    assert chi2(problem) > 5.0
    assert chi2(problem, nuisance) < MET


@pytest.mark.parametrize(
    ("id_", "name", "value"),
    [
        ("joint_friction", "torque_Nm", 0.1),
        ("joint_inertia", "inertia_kg_m2", 0.004),
        ("torque_scale", "factor", 0.8),
        ("added_mass", "mass_kg", 0.15),
    ],
)
def test_an_effect_that_was_concealed_shows_and_is_found_at_its_size(id_, name, value):
    problem = make_swing_problem(campaign(**{id_: {name: value}}))
    assert chi2(problem) > 5.0
    found = least_squares(
        lambda x: normalised(problem, **{id_: {name: x[0]}}),
        [0.7 * value],
        diff_step=1e-2,
        xtol=1e-4,
    )
    assert found.x[0] == pytest.approx(value, rel=0.03)
    assert chi2(problem, **{id_: {name: found.x[0]}}) < MET


def test_nuisances_are_those_of_known_to_for_each_link():
    problem = make_swing_problem(campaign())
    assert problem.nuisances[:2] == (
        Nuisance("link1.mass_relative", 0.05),
        Nuisance("link1.torque_offset_Nm", 0.02),
    )
    assert [n.name for n in problem.nuisances[2:]] == [
        "link2.mass_relative",
        "link2.torque_offset_Nm",
    ]


def test_every_key_of_known_to_moves_what_it_names():
    from rfca_rig.campaign.pendulum import KnownToPendulum

    for key in set(KnownToPendulum.model_fields) - {
        "torque_error_relative"
    }:  # that is the scale of the model's error
        moved = apply_nuisances(BELIEVED, {f"link2.{key}": 0.01})
        assert moved.links[0] == BELIEVED.links[0]
        assert moved.links[1] != BELIEVED.links[1]
    centre = apply_nuisances(BELIEVED, {"link1.centre_of_mass_m": 0.02}).links[0]
    assert centre.inertia_kg_m2 - 0.6 * centre.centre_of_mass_m**2 == pytest.approx(
        0.022 - 0.6 * 0.18**2
    )


@pytest.mark.parametrize(
    "name",
    [
        "link3.mass_relative",
        "link0.mass_relative",
        "mass_relative",
        "link1.colour",
        "linkx.mass_relative",
    ],
)
def test_another_nuisance_is_refused(name):
    with pytest.raises(BadInput, match="is no nuisance of a pendulum of 2"):
        apply_nuisances(BELIEVED, {name: 0.0})


def bounced(at_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times, positions (m, 2), noise, and the true speed at `at_s`: joint 1 presses on a spring
    of 25 Hz, joint 2 swings at 1 Hz.
    """
    fast = 2.0 * np.pi * 25.0
    slow = 2.0 * np.pi
    t_s = np.arange(-0.2, 0.2, 0.002)
    # Free before 0, in contact until half a period of the spring has passed, free again with the
    # speed turned.
    position = np.where(
        t_s < 0.0, -t_s, np.where(t_s < 0.02, -np.sin(fast * t_s) / fast, t_s - 0.02)
    )
    if at_s < 0.0:
        speed = -1.0
    elif at_s < 0.02:
        speed = float(-np.cos(fast * at_s))
    else:
        speed = 1.0
    noise = np.full(2, 5e-5)
    measured = np.column_stack([position, 0.1 * np.sin(slow * t_s)]) + np.random.default_rng(
        3
    ).normal(0.0, noise, (t_s.size, 2))
    return t_s, measured, noise, speed


@pytest.mark.parametrize("at_s", [-0.03, -0.024, 0.044, 0.05])
def test_the_start_near_an_impact_is_estimated_from_a_narrower_stretch(at_s):
    t_s, measured, noise, speed = bounced(at_s)
    wide = local_polynomial(t_s, measured, at_s)
    _, estimated, _, std = estimate_start(t_s, measured, at_s, noise)
    assert abs(wide.derivative(1)[0] - speed) > 0.03
    assert abs(estimated[0] - speed) < 0.02
    assert abs(estimated[0] - speed) < 4.0 * std[0]
    # The other joint moves smoothly and keeps the widest stretch.
    assert estimated[1] == wide.derivative(1)[1]


def test_runs_too_short_for_a_window_are_refused():
    with pytest.raises(BadInput, match="no run of simulated is longer than"):
        make_swing_problem(campaign(), window_s=5.0)


REAL = 5e-3, 0.05  # rad, rad/s that no model of a real rig is expected to meet


def fitted(problem, id_, name, low, high):
    """The effect's value and the mean square of the rows, with nominal values free as far as
    they are known.
    """
    nuisances = problem.nuisances
    start = 0.8 * low + 0.2 * high
    expected = np.hypot(
        problem.noise_std, np.where(problem.signal_of_row < len(problem.signals) // 2, *REAL)
    )

    def rows(x):
        off = {
            nuisance.name: nuisance.std * (value - 1.0)
            for nuisance, value in zip(nuisances, x, strict=False)
        }
        misses = (
            problem.predicted(off, having(**{id_: {name: start * x[-1]}})) - problem.measured
        ) / expected
        return np.append(misses, x[:-1] - 1.0)

    farthest = np.append(np.full(len(nuisances), 5.0), np.inf)
    bounds = np.append(1.0 - farthest[:-1], 0.0), 1.0 + farthest
    found = least_squares(
        rows,
        np.ones(len(farthest)),
        bounds=bounds,
        diff_step=0.02,
        x_scale=0.3,
        xtol=1e-3,
        ftol=1e-3,
        max_nfev=20,
    )
    return start * found.x[-1], 2 * found.cost / problem.measured.size


@pytest.mark.slow
def test_in_a_real_pendulum_the_friction_that_was_left_out_explains_most_and_other_effects_do_not():
    problem = make_swing_problem(
        read_pendulum_campaign(DATA / "simple")
    )  # in one run alone, an inertia with more damping imitates friction
    torque_Nm, with_friction = fitted(problem, "joint_friction", "torque_Nm", 0.0, 0.5)
    assert 0.08 < torque_Nm < 0.25
    for other in (
        ("joint_inertia", "inertia_kg_m2", 0.0, 0.05),
        ("torque_scale", "factor", 0.8, 1.2),
        ("added_mass", "mass_kg", 0.0, 0.5),
    ):
        assert fitted(problem, *other)[1] > 2 * with_friction, other


OTHERS = {
    "joint_inertia": ("inertia_kg_m2", 0.0, 0.05),
    "torque_scale": ("factor", 0.8, 1.2),
    "added_mass": ("mass_kg", 0.0, 0.5),
    "fluid_drag": ("coefficient_N_s2_per_m3", 0.0, 2.0),
    "hinge_viscous_damping": ("coefficient_Nm_s_per_rad", 0.0, 0.1),
}


@pytest.mark.long
@pytest.mark.parametrize("name", ["simple", "double"])
def test_no_single_effect_explains_a_real_pendulum_as_friction_does(name):
    problem = make_swing_problem(read_pendulum_campaign(DATA / name))
    torque_Nm, with_friction = fitted(problem, "joint_friction", "torque_Nm", 0.0, 0.5)
    assert 0.08 < torque_Nm < 0.25
    assert (
        min(fitted(problem, id_, *other)[1] for id_, other in OTHERS.items()) > 2.5 * with_friction
    )


@pytest.mark.long
def test_a_real_weight_that_was_added_shows_as_more_mass_or_less_torque_and_as_nothing_else():
    problem = make_swing_problem(read_pendulum_campaign(DATA / "simple-heavier"))
    mass_kg, with_mass = fitted(problem, "added_mass", "mass_kg", 0.0, 2.0)
    assert 0.3 < mass_kg < 1.2
    friction = fitted(problem, "joint_friction", "torque_Nm", 0.0, 0.5)[1]
    drag = fitted(problem, "fluid_drag", *OTHERS["fluid_drag"])[1]
    inertia = fitted(problem, "joint_inertia", *OTHERS["joint_inertia"])[1]
    assert min(friction, drag, inertia) > 1.3 * with_mass
