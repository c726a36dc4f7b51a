"""Cases of the exam on pendulums: a rig, its nominal values and its hidden effects, drawn from one
seed.

Sizes follow the rig: torques are shares of the weight's largest torque, speeds those of its small
oscillation. Strength 0 is hardly visible in angles read to a milliradian, 1 is gross.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rfca_rig.exam.pendulums.world import G_M_S2, Friction, PendulumWorld

PENDULUM_NOTHING, PENDULUM_SINGLE, PENDULUM_PAIR, PENDULUM_STRANGER = PENDULUM_KINDS = (
    "pendulum, nothing missing",
    "pendulum, one effect",
    "pendulum, two effects",
    "pendulum, stranger",
)

Values = dict[str, float]

KNOWN_TO: Mapping[str, float] = {
    "mass_relative": 0.02,
    "centre_of_mass_m": 0.003,
    "zero_offset_rad": 0.003,
    "torque_delay_s": 0.001,
}
# Standard deviations of damping and torque offset, as shares of the rig's own scales.
DAMPING_SHARE = 0.005
OFFSET_SHARE = 0.01

# From faint to strong: shares of the rig's torque, damping, drag, inertia and mass, deviations of a
# factor from 1, seconds, radians.
SPANS: Mapping[str, tuple[float, float]] = {
    "joint_friction": (0.01, 0.3),
    "joint_stribeck": (0.02, 0.25),
    "joint_load_friction": (0.04, 0.5),
    "joint_damping": (0.02, 0.4),
    "fluid_drag": (0.02, 0.4),
    "joint_inertia": (0.02, 0.6),
    "added_mass": (0.02, 0.5),
    "torque_scale": (0.04, 0.5),
    "torque_delay": (0.003, 0.03),
    "torque_lag": (0.003, 0.04),
    "speed_lag": (0.003, 0.03),
    "angle_lag": (0.003, 0.03),
    "gravity_tilt": (0.01, 0.12),
    "joint_friction_of_one": (0.01, 0.3),
}
STRANGERS: Mapping[str, tuple[float, float]] = {
    "cable_spring": (0.05, 0.5),
    "torque_cogging": (0.04, 0.4),
    "torque_saturation": (0.9, 0.35),
    "joint_friction_by_direction": (0.1, 0.3),
}
# Pairs that the data of a pendulum cannot separate. Two kinds of dry friction cannot be separated
# either.
NEVER_TOGETHER = ({"torque_delay", "torque_lag"}, {"speed_lag", "angle_lag"})
DRY = ("joint_friction", "joint_stribeck", "joint_load_friction", "joint_friction_of_one")


@dataclass(frozen=True)
class SamplingErrors:
    """Sampling period and standard deviations of the noise of angles and speeds."""

    sample_s: float = 0.004
    angle_std_rad: float = 5e-4
    speed_std_rad_s: float = 0.02


@dataclass(frozen=True)
class PendulumCase:
    """One campaign of a pendulum. `world` is the rig without hidden effects, `nominal` its nominal
    values.

    `effects` are of the catalogue, `strangers` are outside it; both by id, with their parameters.
    """

    id: str
    kind: str
    seed: int
    world: PendulumWorld
    nominal: PendulumWorld
    reading: SamplingErrors
    driven: tuple[bool, ...]
    effects: Mapping[str, Values] = field(default_factory=dict)
    strangers: Mapping[str, Values] = field(default_factory=dict)
    strength: float = 0.0
    friction: Friction = field(default=Friction())
    drag_power: float = 2.0

    @property
    def concealed(self) -> PendulumWorld:
        """The true rig, with all hidden effects."""
        world = replace(self.world, friction=self.friction, drag_power=self.drag_power)
        for name, values in (*self.effects.items(), *self.strangers.items()):
            world = _WITH[name](world, values)
        return world


def torque_scale_Nm(world: PendulumWorld) -> float:
    """The largest torque in N m of the weight about the first joint, with the links stretched
    out horizontally.
    """
    moments = np.multiply(world.mass_kg, world.centre_m)
    return float(G_M_S2 * (moments.sum() + sum(world.mass_kg[1:]) * world.length_m[0]))


def swing_rad_s(world: PendulumWorld) -> float:
    """Angular frequency in rad/s of a small oscillation of the first link alone."""
    return float(np.sqrt(G_M_S2 * world.mass_kg[0] * world.centre_m[0] / world.inertia_kg_m2[0]))


def draw_pendulum(kind: str, i: int, random: np.random.Generator) -> PendulumCase:
    """Draw case `i` of a kind; its id is left empty."""
    nominal = _draw_rig(random)
    world = _draw_true_rig(nominal, random)
    reading = SamplingErrors(
        float(random.choice([0.002, 0.004, 0.005])), float(random.uniform(2e-4, 1e-3))
    )
    driven = (True, True, bool(random.random() < 0.6))
    case = PendulumCase("", kind, int(random.integers(2**31)), world, nominal, reading, driven)
    law = Friction(
        rise_power=float(random.uniform(0.8, 2.0)),
        loss_power=float(random.uniform(0.9, 1.1)),
        sign_rad_s=float(np.exp(random.uniform(np.log(2e-3), np.log(2e-2)))),
        sign=str(random.choice(["tanh", "root", "atan"])),
    )
    case = replace(case, friction=law, drag_power=float(random.uniform(1.9, 2.1)))
    if kind == PENDULUM_NOTHING:
        return case
    if kind == PENDULUM_STRANGER:
        name = tuple(STRANGERS)[i % len(STRANGERS)]
        strength = float(random.uniform(0.3, 1.0))
        return replace(
            case, strangers={name: _values(name, strength, world, random)}, strength=strength
        )
    possible = [name for name in SPANS if world.joints > 1 or name != "joint_friction_of_one"]
    if kind == PENDULUM_SINGLE:
        # A stride through the effects, so that the first few cases are a mixture too; the five
        # levels in turn.
        name = possible[5 * i % len(possible)]
        strength = (i % 5 + float(random.random())) / 5.0
        return replace(
            case, effects={name: _values(name, strength, world, random)}, strength=strength
        )
    # Rejection: pairs that no data can separate would have no right answer.
    while True:
        names = [possible[j] for j in random.choice(len(possible), 2, replace=False)]
        if set(names) not in NEVER_TOGETHER and not set(names) <= set(DRY):
            strength = float(random.uniform(0.4, 1.0))
            return replace(
                case,
                effects={name: _values(name, strength, world, random) for name in names},
                strength=strength,
            )


def _draw_rig(random: np.random.Generator) -> PendulumWorld:
    links = 1 if random.random() < 0.6 else 2
    length = random.uniform(0.25, 0.6, links)
    mass = random.uniform(0.2, 1.2, links)
    centre = length * random.uniform(0.55, 0.9, links)
    # More than a point mass at the centre has, so that the inertia is possible.
    inertia = mass * centre**2 * (1.0 + random.uniform(0.05, 0.3, links))
    rig = PendulumWorld(tuple(length), tuple(mass), tuple(centre), tuple(inertia), (0.0,) * links)
    damping = 0.01 * torque_scale_Nm(rig) / swing_rad_s(rig)
    return replace(rig, damping_Nm_s_per_rad=(float(damping * random.uniform(0.2, 1.0)),) * links)


def _draw_true_rig(nominal: PendulumWorld, random: np.random.Generator) -> PendulumWorld:
    """The rig behind its nominal values: each value differs by a normal deviate of its stated
    standard deviation.
    """
    off = random.standard_normal((6, nominal.joints))
    mass = np.multiply(nominal.mass_kg, 1.0 + KNOWN_TO["mass_relative"] * off[0])
    centre = np.add(nominal.centre_m, KNOWN_TO["centre_of_mass_m"] * off[2])
    # The inertia about the centre of mass scales with the mass and does not depend on where that
    # centre is.
    inertia = np.multiply(nominal.inertia_kg_m2, mass / nominal.mass_kg) + mass * (
        centre**2 - np.square(nominal.centre_m)
    )
    damping = np.add(nominal.damping_Nm_s_per_rad, damping_std(nominal) * off[1])
    return replace(
        nominal,
        mass_kg=tuple(mass.tolist()),
        centre_m=tuple(centre.tolist()),
        inertia_kg_m2=tuple(inertia.tolist()),
        damping_Nm_s_per_rad=tuple(np.maximum(damping, 0.0).tolist()),
        torque_offset_Nm=tuple((offset_std(nominal) * off[3]).tolist()),
        angle_zero_rad=tuple((KNOWN_TO["zero_offset_rad"] * off[4]).tolist()),
        torque_delay_s=float(KNOWN_TO["torque_delay_s"] * abs(off[5, 0])),
    )


def damping_std(world: PendulumWorld) -> float:
    """Standard deviation of the damping of a joint, N m s / rad."""
    return DAMPING_SHARE * torque_scale_Nm(world) / swing_rad_s(world)


def offset_std(world: PendulumWorld) -> float:
    """Standard deviation of the offset of a torque, N m."""
    return OFFSET_SHARE * torque_scale_Nm(world)


def _values(
    name: str, strength: float, world: PendulumWorld, random: np.random.Generator
) -> Values:
    """Parameter values of an effect, in or outside the catalogue, at a strength from 0 to 1."""
    faint, strong = {**SPANS, **STRANGERS}[name]
    share = float(faint * (strong / faint) ** strength)
    sign = float(random.choice([-1.0, 1.0]))
    torque = torque_scale_Nm(world)
    speed = swing_rad_s(world)
    # All entries draw their numbers, whichever is used: a case's random stream does not depend on
    # its effect.
    values: Mapping[str, Values] = {
        "joint_friction": {"torque_Nm": share * torque},
        "joint_stribeck": {
            "torque_Nm": share * torque,
            "rise_relative": float(random.uniform(0.4, 1.5)),
            "speed_rad_s": float(random.uniform(0.3, 2.0)),
        },
        "joint_load_friction": {"loss_relative": share},
        "joint_damping": {"coefficient_Nm_s_per_rad": share * torque / speed},
        "fluid_drag": {
            "coefficient_N_s2_per_m3": 8.0 * share * torque / (speed**2 * sum(world.length_m) ** 4)
        },
        "joint_inertia": {"inertia_kg_m2": share * world.inertia_kg_m2[0]},
        "added_mass": {"mass_kg": share * sum(world.mass_kg)},
        "torque_scale": {"factor": float((1.0 + share) ** sign)},
        "torque_delay": {"delay_s": share},
        "torque_lag": {"time_constant_s": share},
        "speed_lag": {"time_constant_s": share},
        "angle_lag": {"time_constant_s": share},
        "gravity_tilt": {"angle_rad": sign * share},
        "joint_friction_of_one": {
            "joint": float(random.integers(1, 3)),
            "torque_Nm": share * torque,
        },
        "cable_spring": {"stiffness_Nm_per_rad": share * torque},
        "torque_cogging": {"torque_Nm": share * torque},
        "torque_saturation": {"limit_Nm": share * torque},
        "joint_friction_by_direction": {"torque_Nm": share * torque, "backward_share": 0.3},
    }
    return values[name]


def _add_dry_friction(world: PendulumWorld, values: Values) -> PendulumWorld:
    """Add dry friction in every joint, or in the one that `values` names (from 1)."""
    joint = int(values.get("joint", 0))
    more = [
        values["torque_Nm"] if joint in (0, number + 1) else 0.0 for number in range(world.joints)
    ]
    dry = tuple(float(a + b) for a, b in zip(world.friction.dry_Nm, more, strict=False))
    friction = replace(world.friction, dry_Nm=dry, backward=values.get("backward_share", 1.0))
    if "rise_relative" in values:
        friction = replace(friction, rise=values["rise_relative"], rise_rad_s=values["speed_rad_s"])
    return replace(world, friction=friction)


def _add_damping(world: PendulumWorld, values: Values) -> PendulumWorld:
    return replace(
        world,
        damping_Nm_s_per_rad=tuple(
            c + values["coefficient_Nm_s_per_rad"] for c in world.damping_Nm_s_per_rad
        ),
    )


def _add_load_friction(world: PendulumWorld, values: Values) -> PendulumWorld:
    return replace(
        world,
        friction=replace(
            world.friction, loss=values["loss_relative"], loss_at_Nm=0.3 * torque_scale_Nm(world)
        ),
    )


_WITH: Mapping[str, Callable[[PendulumWorld, Values], PendulumWorld]] = {
    "joint_friction": _add_dry_friction,
    "joint_friction_of_one": _add_dry_friction,
    "joint_stribeck": _add_dry_friction,
    "joint_friction_by_direction": _add_dry_friction,
    "joint_load_friction": _add_load_friction,
    "joint_damping": _add_damping,
    "fluid_drag": lambda world, v: replace(world, drag_N_s2_per_m3=v["coefficient_N_s2_per_m3"]),
    "joint_inertia": lambda world, v: replace(world, rotor_kg_m2=v["inertia_kg_m2"]),
    "added_mass": lambda world, v: replace(world, tip_mass_kg=v["mass_kg"]),
    "torque_scale": lambda world, v: replace(world, torque_scale=v["factor"]),
    "torque_delay": lambda world, v: replace(
        world, torque_delay_s=world.torque_delay_s + v["delay_s"]
    ),
    "torque_lag": lambda world, v: replace(world, torque_lag_s=v["time_constant_s"]),
    "speed_lag": lambda world, v: replace(world, speed_lag_s=v["time_constant_s"]),
    "angle_lag": lambda world, v: replace(world, angle_lag_s=v["time_constant_s"]),
    "gravity_tilt": lambda world, v: replace(world, tilt_rad=v["angle_rad"]),
    "cable_spring": lambda world, v: replace(world, spring_Nm_per_rad=v["stiffness_Nm_per_rad"]),
    "torque_cogging": lambda world, v: replace(world, cogging_Nm=v["torque_Nm"]),
    "torque_saturation": lambda world, v: replace(world, saturates_at_Nm=v["limit_Nm"]),
}
