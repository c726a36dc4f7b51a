"""A simulator that the package does not know, a driven mass on a spring, and its recordings by
SciPy.
"""

from dataclasses import dataclass, replace
from math import tanh

import numpy as np
from scipy.integrate import solve_ivp

from rfca_rig.analysis.fitting.space import FitParameter as Nuisance
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.diagnosis.data import Label, Observations
from rfca_rig.diagnosis.simulator import Simulator
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.model.parameters import PresentEffect

STEP_S = 0.002
READ_EVERY = 25  # steps
STEPS = 1500
NOISE = {"x_m": 2e-4, "v_m_s": 2e-3}


@dataclass(frozen=True)
class Oscillator:
    """m x'' + c x' + k x = F sin(w t) - friction: the input of the simulator."""

    mass_kg: float = 1.0
    damping_N_s_per_m: float = 0.8
    stiffness_N_per_m: float = 60.0
    friction_N: float = 0.0
    drag_N_s2_per_m2: float = 0.0
    effects: tuple[PresentEffect, ...] = ()
    unchanged = None
    rig = None  # asked for only where an effect is counted from a value of the leg

    def with_effects(self, effects):
        return replace(self, effects=(*self.effects, *effects))

    def replace_effects(self, effects):
        return replace(self, effects=effects)


def adding(id_, field, low, high):
    def apply(setup, values):
        return replace(setup, **{field: getattr(setup, field) + values[field]})

    return Effect(id_, "mass", f"{id_} of the mass", "", "", (Parameter(field, low, high),), apply)


CATALOGUE = {
    effect.id: effect
    for effect in (
        adding("coulomb", "friction_N", 0.02, 2.0),
        adding("extra_mass", "mass_kg", 0.005, 0.5),
        adding("square_drag", "drag_N_s2_per_m2", 0.02, 5.0),
    )
}


@dataclass(frozen=True, eq=False)
class Shaking:
    """One amplitude and frequency of the drive, with what was read."""

    force_N: float
    rate_rad_s: float
    read: np.ndarray = None

    @property
    def repeats(self):
        return np.empty((1, 0))

    def rows(self):
        each = STEPS // READ_EVERY
        t_s = STEP_S * READ_EVERY * np.arange(1, each + 1)
        # a force that is wrong by a share of the drive's moves the mass by that share of its steady
        # swing
        swing_m = self.force_N / np.hypot(60.0 - self.rate_rad_s**2, 0.8 * self.rate_rad_s)
        scale = np.repeat([swing_m, self.rate_rad_s * swing_m], each)
        return Observations(
            measured=self.read,
            noise=np.repeat(list(NOISE.values()), each),
            scale=scale,
            transient_scale=0.1 * scale,
            progress=np.tile(t_s, 2),
            t_s=np.tile(t_s, 2),
            phase=np.full(2 * each, "shaking"),
            label=np.repeat([0, 1], each),
            condition=np.zeros(2 * each, dtype=np.intp),
            labels=tuple(
                Label("shaking", f"{self.force_N:g} N, {self.rate_rad_s:g} rad/s", signal, 0.2)
                for signal in NOISE
            ),
        )


class OscillatorSimulator(Simulator):
    """Semi-implicit Euler steps; implements nothing but `simulate`."""

    def simulate(self, at, condition):
        setup = at
        for present in at.effects:
            setup = CATALOGUE[present.id].apply(setup, dict(present.values))
        if setup.stiffness_N_per_m < 0.0:
            raise SimulationFailed("a spring that pushes away")
        drive = (
            condition.force_N * np.sin(condition.rate_rad_s * STEP_S * np.arange(STEPS))
        ).tolist()
        m = setup.mass_kg
        c = setup.damping_N_s_per_m
        k = setup.stiffness_N_per_m
        friction = setup.friction_N
        drag = setup.drag_N_s2_per_m2
        x = v = 0.0
        found = []
        for n, force in enumerate(drive, start=1):
            v += (
                STEP_S * (force - c * v - k * x - friction * tanh(v / 0.01) - drag * abs(v) * v) / m
            )
            x += STEP_S * v
            if n % READ_EVERY == 0:
                found.append((x, v))
        return np.array(found).T.ravel()


def recorded(condition, friction, seed, mass_kg=1.0):
    """What scipy makes of the condition, with 0.5 % more stiffness and 5 % more damping than
    nominal.
    """
    random = np.random.default_rng(seed)
    t_s = STEP_S * READ_EVERY * np.arange(1, STEPS // READ_EVERY + 1)

    def rhs(t, state):
        x, v = state
        drive_N = condition.force_N * np.sin(condition.rate_rad_s * t)
        return [v, (drive_N - 0.84 * v - 60.3 * x - friction(v)) / mass_kg]

    found = solve_ivp(
        rhs, (0.0, t_s[-1]), [0.0, 0.0], "LSODA", t_s, rtol=1e-8, atol=1e-10, max_step=5e-3
    ).y
    noise = np.repeat(list(NOISE.values()), len(t_s))
    return replace(condition, read=found.ravel() + noise * random.standard_normal(noise.size))


def nuisance_space():
    """Stiffness and damping, known to 1 and 10 %."""
    nuisances = (
        Nuisance(
            "stiffness",
            "N/m",
            True,
            0.01,
            lambda at: at.stiffness_N_per_m,
            lambda at, k: replace(at, stiffness_N_per_m=k),
        ),
        Nuisance(
            "damping",
            "N s/m",
            True,
            0.1,
            lambda at: at.damping_N_s_per_m,
            lambda at, c: replace(at, damping_N_s_per_m=c),
        ),
    )
    return Prior(
        nuisances, Oscillator(), np.array([p.spread for p in nuisances]), np.ones(2, dtype=bool)
    )
