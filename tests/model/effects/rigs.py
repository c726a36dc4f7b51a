"""Rigs with effects, and short ways to simulate them."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import Tolerance, advance, allocate_samples, find_rest_state
from rfca_rig.model.kernel.state import Samples, State
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import Setup
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed
from tests.model.legs import NO_GROUND_M, PAPER

T = np.arange(-20, 560) * 2e-3
TIGHT = Tolerance(1e-8, 3e-5)

Named = dict[str, float]


def having(rig: RigModel, **effects: Named) -> RigModel:
    return replace(
        rig,
        effects=tuple(PresentEffect(id_, tuple(values.items())) for id_, values in effects.items()),
    )


def paper_stroke(tolerance: Tolerance | None = None, **effects: Named) -> SimulatedStroke:
    """The paper's stroke, contact and lift-off included, after twenty others."""
    return simulate_stroke_at_speed(
        having(PAPER, **effects), 0.215, 2.433, T, tolerance, strokes_before=(20,)
    )


def held(angle_rad: float) -> ShaftMotion:
    """A shaft that never moves."""
    return ShaftMotion(
        np.array([0.0, 1e3]), np.array([[angle_rad, 0.0, 0.0, 0.0]]), np.array([0.0])
    )


def through(times_s: list[float], angles_rad: list[float]) -> ShaftMotion:
    """A shaft that turns evenly from one angle to the next."""
    breaks = np.array(times_s)
    angles = np.array(angles_rad)
    speeds = np.diff(angles) / np.diff(breaks)
    return ShaftMotion(
        breaks,
        np.array([[q, w, 0.0, 0.0] for q, w in zip(angles[:-1], speeds, strict=True)]),
        breaks[:-1],
    )


def resting(rig: RigModel, angle_rad: float, height_m: float = NO_GROUND_M) -> tuple[Setup, State]:
    """The leg at rest with its shaft held."""
    setup = set_up(rig, height_m, held(angle_rad))
    chain = setup.chain()
    return setup, find_rest_state(chain, angle_rad, setup.compile_laws(chain))


def released(
    rig: RigModel,
    q: list[float],
    t_s: np.ndarray,
    tolerance: Tolerance = TIGHT,
    speed_rad_s: float = 0.0,
    **changes: float,
) -> Samples:
    """Weightless unless told, the shaft held at q[0], let go from the pose q; the links behind
    the shaft's turn at `speed_rad_s`.
    """
    setup = set_up(rig, NO_GROUND_M, held(q[0]))
    chain = setup.chain()._replace(**{"gravity": 0.0, **changes})
    laws = setup.compile_laws(chain)
    state = find_rest_state(chain, q[0], laws)
    state.q[: len(q)] = q
    state.w[1 : len(q)] = speed_rad_s
    samples = allocate_samples(t_s, state.q.size, len(chain.length))
    advance(
        chain, setup.motion.shaft(), state, (0.0, float(t_s[-1])), 1e-6, tolerance, samples, laws
    )
    return samples
