"""The derivative of the residual with effects, against central differences."""

import numpy as np
import pytest

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.kernel.contact import locate_ends, store_ends
from rfca_rig.model.kernel.forces import assemble_once, prepare_pose
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import State
from tests.model.effects.rigs import having, held
from tests.model.effects.test_strength import SMALL
from tests.model.legs import PAPER

WEIGHTS = (0.7, 0.02, 3e-3)
FRAME = {"frame_compliance": {"frequency_Hz": 20.0, "moving_mass_kg": 0.5, "damping_ratio": 0.5}}
SWAYS = {"frame_compliance": FRAME["frame_compliance"] | {"lean_deg": 60.0}}
TILT = {"ground_tilt": {"slope": 0.1}}
ADHESION = {"ground_adhesion": {"force_N": 200.0}}
STRIBECK = {"ground_stribeck": {"rise_relative": 1.0, "speed_m_s": 0.3}}
BUMP = {"ground_bump": {"height_mm": 3.0, "at_mm": 60.0, "width_mm": 30.0}}
LINE = {"ground_exponent": {"exponent": 1.0}}
ONLY_IN_POSITION = (0.0, 0.0, 1.0)
ONLY_IN_SPEED = (0.0, 1.0, 0.0)


def pose(links: int, coordinates: int):
    """Bent towards the floor, several ends in it, all moving."""
    random = np.random.default_rng(7)
    q = np.linspace(1.0, 1.6, links)
    w = random.normal(0, 2, links)
    a = random.normal(0, 50, links)
    rest = coordinates - links
    return np.append(q, [2e-4] * rest), np.append(w, [0.3] * rest), np.append(a, [20.0] * rest)


def assembled(effects, weights, shift=None):
    setup = set_up(having(PAPER, **effects), 0.2, held(1.0))
    chain = setup.chain()._replace(drag=200.0)
    laws = setup.compile_laws(chain)
    q, w, a = pose(7, 7 + (chain.frame_mass > 0))
    random = np.random.default_rng(11)
    anchor = (
        np.cumsum(
            chain.length * (np.cos(q[:7]) * chain.floor_cos + np.sin(q[:7]) * chain.floor_sin)
        )
        - 0.003 * q[:7]
    )
    anchor += 1e-5 * random.normal(size=7)
    memory = np.zeros((laws.place.size, 7, 4))
    memory[:, 1:, 0] = random.uniform(-0.05, 0.2, 6)
    memory[:, 1:, 1] = random.uniform(-0.1, 0.2, 6)
    state = State(q, w, a, anchor, memory)
    work = allocate_workspace(q.size, 7)
    prepare_pose(chain, q, work)
    locate_ends(chain, state, q, w, work)
    store_ends(chain, state, q, work)
    s = np.zeros(q.size) if shift is None else shift
    moved = (q + weights[2] * s, w + weights[1] * s, a + weights[0] * s)
    assemble_once(chain, laws, state, 0.01, *moved, weights, work)
    assert (work.contact[0] != 0).sum() >= 2
    return work.R.copy(), work.J.copy()


def differenced(effects, weights):
    size = assembled(effects, weights)[0].size
    step = 1e-6 / max(1.0, weights[2])
    pairs = [
        [assembled(effects, weights, sign * step * row)[0] for sign in (1, -1)]
        for row in np.eye(size)
    ]
    return np.column_stack([(plus - minus) / (2 * step) for plus, minus in pairs])


@pytest.mark.parametrize(
    "effects",
    [
        *(
            {name: SMALL[name]}
            for name in (
                "hinge_coulomb_friction",
                "hinge_backlash",
                "hinge_stop",
                "spring_hysteresis",
                "spring_relaxation",
            )
        ),
        ADHESION,
        STRIBECK,
        TILT | ADHESION,
        {"gravity_tilt": {"angle_rad": 0.1}} | STRIBECK,
        FRAME,
        FRAME | TILT,
        SWAYS | TILT,
        FRAME | TILT | ADHESION | STRIBECK,
        LINE | TILT | STRIBECK,
        BUMP,
        SWAYS | TILT | BUMP | STRIBECK,
        {"hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.3}},
        {"heavier_link": {"link": 3.0, "mass_factor": 3.0}} | FRAME,
    ],
    ids=" ".join,
)
@pytest.mark.parametrize(
    "weights", [WEIGHTS, ONLY_IN_POSITION, ONLY_IN_SPEED], ids=["together", "position", "speed"]
)
def test_the_derivative_with_effects_is_that_of_the_residual(effects, weights):
    exact = assembled(effects, weights)[1]
    assert differenced(effects, weights) == pytest.approx(
        exact, rel=3e-5, abs=1e-6 * np.abs(exact).max()
    )


@pytest.mark.parametrize("frame", [{}, FRAME], ids=["fixed", "on a frame"])
def test_the_derivative_of_drag_is_exact_in_the_speeds(frame):
    effects = {"fluid_drag": {"coefficient_N_s2_per_m3": 50.0}} | frame
    exact = assembled(effects, ONLY_IN_SPEED)[1]
    assert differenced(effects, ONLY_IN_SPEED) == pytest.approx(
        exact, rel=3e-5, abs=1e-6 * np.abs(exact).max()
    )
