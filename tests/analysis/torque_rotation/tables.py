"""Static tables from engines that know nothing of the analysis: the exam's simulator in time,
and MuJoCo at rest.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.analysis.mujoco_leg import mujoco_leg, settle_at_rest
from rfca_rig.description.model_file import nominal_model
from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.simulator.experiment import READ_S, STEP_S, plan_stages, sense, simulate
from rfca_rig.exam.simulator.world import World
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.model import Recording, StaticStage
from tests.report.recordings import BELIEVED

Floats = NDArray[np.float64]

NOISE = {"fy_N": 0.10, "fz_N": 0.15, "tx_Nm": 0.006}
SECTIONS = {**BELIEVED, "sensor": {"below_shaft_mm": 45.0, "noise_std": NOISE}}
KNOWN_TO = {
    "height_mm": 0.2,
    "start_angle_deg": 0.3,
    "mass_relative": 0.01,
    "contact_stiffness_relative": 0.5,
    "k0_relative": 0.03,
}
RIG = nominal_model(SECTIONS)
ANGLES_DEG = (60, 75, 90, 105, 120, 135, 133, 131)
HEIGHTS_M = (0.215, 0.235)


def k_of(rig: RigModel, phi_rad):
    return rig.leg.k0_Nm_per_rad * (phi_rad + rig.leg.k2_per_rad2 * phi_rad**3)


def by_exam(
    world: World, heights_m: Sequence[float] = HEIGHTS_M, angles_deg: Sequence[float] = ANGLES_DEG
) -> tuple[StaticStage, ...]:
    """Stages without noise, simulated in time; `world` stands at any height."""
    angles = tuple(float(np.radians(angle)) for angle in angles_deg)
    stages = []
    for height_m in heights_m:
        higher = replace(
            world, mount=replace(world.mount, height_m=world.mount.height_m - 0.215 + height_m)
        )
        knots, read_s = plan_stages(world.drive.start_angle_rad, angles, 0.05)
        traces = simulate(higher, knots, read_s, width_s=READ_S, step_s=STEP_S)
        fy, fz, tx = sense(higher, traces)
        for i, angle in enumerate(angles_deg):
            if i and angle < angles_deg[i - 1]:
                way = "unloading"
            else:
                way = "loading"
            bent = tuple(np.degrees(traces.joint_angles_rad[i, 1:]))
            shaft = float(traces.motor_angle_rad[i])
            stages.append(
                StaticStage(
                    height_m, i + 1, way, shaft, bent, float(fy[i]), float(fz[i]), float(tx[i])
                )
            )
    return tuple(stages)


@cache
def plain() -> tuple[StaticStage, ...]:
    """Of the nominal leg."""
    return by_exam(nominal_world(0.215))


def noisy(
    stages: Sequence[StaticStage],
    random: np.random.Generator,
    hinge_deg: float = 0.1,
    force: float = 1.0,
    **known: object,
) -> tuple[StaticStage, ...]:
    """With noise on angles, and on forces a tenth of a sample's times `force`."""
    return tuple(
        replace(
            stage,
            hinge_deg=tuple(
                np.array(stage.hinge_deg) + random.normal(0.0, hinge_deg, len(stage.hinge_deg))
            ),
            fy_N=stage.fy_N + random.normal(0.0, 0.1 * force * NOISE["fy_N"]),
            fz_N=stage.fz_N + random.normal(0.0, 0.1 * force * NOISE["fz_N"]),
            tx_Nm=stage.tx_Nm + random.normal(0.0, 0.1 * force * NOISE["tx_Nm"]),
            shaft_angle_rad=stage.shaft_angle_rad + random.normal(0.0, 1e-4),
            **known,
        )
        for stage in stages
    )


def recording(
    stages: Sequence[StaticStage], title: str = "static", sections=SECTIONS, known_to=KNOWN_TO
) -> Recording:
    return Recording(title, "IMPORT", sections, known_to, (), tuple(stages))


def by_mujoco(
    rig: RigModel,
    height_m: float,
    angles_deg: Sequence[float],
    random: np.random.Generator,
    torque_Nm: Callable[[Floats], Floats] | None = None,
    most_turn_rad: float = np.inf,
) -> tuple[StaticStage, ...]:
    """MuJoCo's equilibria; at every end the floor holds with friction of any sign, as it may after
    any way of getting there.

    A stage is left out where that friction allows no rest near the one before, or where a hinge
    turned by more than `most_turn_rad`: the solver jumped to another branch, which a leg that turns
    slowly does not reach. `torque_Nm` gives the torques (h,) of hinges at angles (h,) in rad, in
    place of the rig's springs.
    """

    def balance(angle_rad, hinges_rad, ratio):
        joints, N, F = _joints(rig, height_m, leg, angle_rad, hinges_rad, ratio)
        if torque_Nm is not None:
            joints[1:] += k_of(rig, hinges_rad) - torque_Nm(hinges_rad)
        return joints, N, F

    leg = mujoco_leg(rig, height_m, False, "Euler")
    settle_at_rest(leg, float(np.radians(angles_deg[0])))
    phi = np.array(leg.data.qpos[1:])
    stages = []
    for number, angle in enumerate(np.radians(angles_deg), start=1):
        before = phi
        ratio = random.uniform(-0.3, 0.3, leg.model.nq)
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            found = root(
                lambda hinges, a=angle, r=share * ratio: balance(a, hinges, r)[0][1:],
                phi,
                tol=1e-12,
            )
            phi = found.x if found.success else phi
        if np.abs(phi - before).max() > most_turn_rad:
            phi = before
            continue
        joints, N, F = balance(angle, phi, ratio)
        if np.abs(joints[1:]).max() > 1e-8:
            continue
        fy = -float(F.sum())
        weight = 9.81 * sum(rig.leg.link_masses_kg)
        tx = -float(joints[0]) + rig.sensor.below_shaft_m * fy
        stages.append(
            StaticStage(
                height_m,
                number,
                "loading",
                float(angle),
                tuple(np.degrees(phi)),
                fy,
                weight - float(N.sum()),
                tx,
            )
        )
    return tuple(stages)


def _joints(rig, height_m, leg, shaft_rad, hinges_rad, ratio):
    """Torques about MuJoCo's joints with the floor's push carried to them by MuJoCo's own
    Jacobians; N and F of the ends.
    """
    mujoco = leg.mujoco
    model = leg.model
    data = leg.data
    data.qpos[0] = shaft_rad
    data.qpos[1:] = hinges_rad
    mujoco.mj_forward(model, data)
    joints = np.array(data.qfrc_smooth)
    N = np.zeros(model.nq)
    F = np.zeros(model.nq)
    jacobian = np.zeros((3, model.nv))
    for k in range(model.nq):
        place = np.array(data.site_xpos[k])
        deep = rig.leg.link_radius_m - place[2] - height_m
        if deep > 0.0:
            N[k] = rig.ground.stiffness_N_per_m1p5 * deep**1.5
            F[k] = ratio[k] * N[k]
            mujoco.mj_jac(
                model, data, jacobian, None, place - [0.0, 0.0, rig.leg.link_radius_m], k + 1
            )
            joints += jacobian.T @ np.array([F[k], 0.0, N[k]])
    return joints, N, F
