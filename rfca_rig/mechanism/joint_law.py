"""Torque of one joint as a table over its speed or its position: a law without a formula.

It is linear between its knots and constant beyond them. A positive value resists a positive speed, or a positive position.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import JointLaw, Plant
from rfca_rig.model.effect import Effect, Values
from rfca_rig.model.parameters import LawTable
from rfca_rig.model.tabulated_law import TABULATED_LAW

Floats = NDArray[np.float64]

QUANTITIES = ("speed", "position")


def name_argument(mechanism: Mechanism, joint: int, quantity: str) -> str:
    """Name of the argument of a table of this joint over its "speed" or "position", with the unit."""
    unit = "m" if mechanism.is_slide[joint] else "rad"
    return f"{quantity}_{unit}_s" if quantity == "speed" else f"{quantity}_{unit}"


def make_tabulated_effect(mechanism: Mechanism, table: LawTable) -> Effect:
    """The effect that puts a table into a plant; its place is a joint's name, its argument as of `name_argument`."""
    joint, count = mechanism.joints.index(table.place), len(table.knots)
    knots, values = np.array(table.knots), np.array(table.values)
    law = JointLaw(joint, table.argument.startswith("speed"), knots, values, np.zeros(count))

    def apply(plant: Plant, values: Values) -> Plant:  # noqa: ARG001
        plant.laws = (*plant.laws, law)
        return plant

    return Effect(TABULATED_LAW, "joints", f"a law of {table.argument} in {table.place}", "tabulated", "measured", (), apply)


def compute_own_law(plant: Plant, joint: int, by_speed: bool, u: Floats) -> Floats | None:
    """Computes the torques (k,) that a plant has already in a joint at speeds or positions `u` (k,), with all else at the reference.

    Friction that depends on the load is no function of the speed and is not included. None where the plant has no torque there.
    """
    import mujoco  # noqa: PLC0415  (optional)

    data = mujoco.MjData(plant.model)
    torque = np.empty(len(u))
    state = data.qvel if by_speed else data.qpos
    for place, value in enumerate(u):
        state[joint] = value
        mujoco.mj_forward(plant.model, data)
        # MuJoCo's passive forces act on the joint; a table holds their resistance.
        torque[place] = -(data.qfrc_damper if by_speed else data.qfrc_spring)[joint]
    if by_speed:
        steady, rise, falls = plant.stribeck[:, joint]
        dry = plant.friction[joint] + steady * (1.0 + rise * np.exp(-np.abs(u) / falls)) + plant.hysteresis[0, joint]
        torque = torque + dry * np.sign(u)
    return torque if torque.any() else None


def pack_laws(laws: tuple[JointLaw, ...]) -> tuple[Floats, Floats]:
    """Laws in the form of the compiled loop: (m, 4) joint, by speed, number of knots, turning; (m, 3, k) knots, values, branches."""
    rows = np.zeros((len(laws), 3, max((len(law.knots) for law in laws), default=0)))
    for place, law in enumerate(laws):
        rows[place, :, : len(law.knots)] = law.knots, law.values, law.branches
    return np.array([[law.joint, law.by_speed, len(law.knots), law.turning] for law in laws], dtype=float).reshape(-1, 4), rows
