"""The paper's mechanics, equation by equation: (1) to (19).

Plain functions of numpy arrays in SI units. Angles count from the horizontal downwards, the first
coordinate runs along the floor and the second down. Where the simulation uses an equation, the
function here calls the same code. Misprints of the paper are corrected, and each docstring says so.
`docs/mechanics.md` has an example of each.

References
----------
"A Type of Actuator with Large Deformation and Load Capacity: Design and Modeling", equations (1) to
(19).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.kernel.contact import normal_force
from rfca_rig.model.paper.dynamics import (
    EndLoads,
    LinkChain,
    joint_accelerations,
    joint_torques_Nm,
    link_chain_of,
    mass_matrix,
    no_loads,
    right_side_Nm,
    solve_exchanged,
)
from rfca_rig.model.paper.elastica import Bent, Holds, bend, even_mesh, mesh_through
from rfca_rig.model.paper.equivalent_stiffness import EncasedStrip, centre_lay
from rfca_rig.model.paper.statics import (
    TipChain,
    TipForceEstimate,
    absolute_angles,
    equilibrium_under_tip_force,
    imbalance_Nm,
    potential_energy_J,
    tip_chain_of,
    tip_force,
    tip_force_weighing_angles,
    tip_jacobian,
    tip_place_m,
    touching_point_jacobian,
)

Floats = NDArray[np.float64]

__all__ = [
    "Bent",
    "EncasedStrip",
    "EndLoads",
    "LinkChain",
    "TipChain",
    "TipForceEstimate",
    "absolute_angles",
    "bend_held_strip",
    "bending_energy_J",
    "centre_lay",
    "contact_pressure_Pa",
    "contact_radius_m",
    "contact_stiffness_N_per_m1p5",
    "coulomb_friction_N",
    "curvature_per_m",
    "discrete_bending_energy_J",
    "effective_modulus_Pa",
    "effective_radius_m",
    "equilibrium_under_tip_force",
    "imbalance_Nm",
    "joint_accelerations",
    "joint_torques_Nm",
    "link_chain_of",
    "mass_matrix",
    "no_loads",
    "normal_force",
    "potential_energy_J",
    "right_side_Nm",
    "second_difference",
    "small_slope_error",
    "small_slope_limit_rad",
    "solve_exchanged",
    "solve_held_contact",
    "spring_energy_J",
    "stick_friction_N",
    "tip_chain_of",
    "tip_force",
    "tip_force_weighing_angles",
    "tip_jacobian",
    "tip_place_m",
    "touching_point_jacobian",
]


def curvature_per_m(slope: Floats, second_derivative_per_m: Floats) -> Floats:
    """Curvature of a line y(x).

    Parameters
    ----------
    slope
        y', (m,) or any other shape.
    second_derivative_per_m
        y'', of the same shape [1/m].

    Returns
    -------
    (m,) [1/m].

    References
    ----------
    Equation (1).
    """
    return np.asarray(np.abs(second_derivative_per_m) / (1.0 + np.asarray(slope) ** 2) ** 1.5)


def small_slope_error(angle_rad: Floats) -> Floats:
    """Relative error of |y''| as an estimate of the curvature, where the line has this angle: sec^3
    - 1.

    Parameters
    ----------
    angle_rad
        (m,) or any other shape, between -pi/2 and pi/2.

    Returns
    -------
    (m,), relative to the curvature.

    References
    ----------
    Equation (1) with y' = tan(angle).
    """
    return np.asarray(np.cos(angle_rad) ** -3.0 - 1.0)


def small_slope_limit_rad(share: float = 0.1) -> float:
    """Angle beyond which |y''| exceeds the curvature by more than a share of it.

    For a tenth this is 0.251 rad; where the error is counted as a share of |y''| it is 0.263 rad.
    The paper says 0.27 rad.

    Parameters
    ----------
    share
        Above 0.

    Returns
    -------
    float [rad].

    Raises
    ------
    BadInput
        For a share that is not above 0.
    """
    if share <= 0.0:
        raise BadInput(f"share {share:g}: an error that is allowed must be above 0")
    return float(np.arccos((1.0 + share) ** (-1.0 / 3.0)))


def bending_energy_J(EI_Nm2: float, s_m: Floats, curvature_per_m: Floats) -> float:
    """Bending energy of a strip, by the trapezoid rule: an error of second order in the spacing.

    Parameters
    ----------
    EI_Nm2
        Bending stiffness.
    s_m, curvature_per_m
        (m,) places along the strip, ascending, and the curvature there.

    Returns
    -------
    float [J].

    References
    ----------
    Equation (2).
    """
    return float(np.trapezoid(0.5 * EI_Nm2 * np.asarray(curvature_per_m) ** 2, s_m))


def spring_energy_J(stiffness_Nm_per_rad: Floats, phi_rad: Floats) -> float:
    """Energy of the equivalent torsion springs.

    Parameters
    ----------
    stiffness_Nm_per_rad, phi_rad
        (n,) of each hinge, or one stiffness for all.

    Returns
    -------
    float [J].

    References
    ----------
    Equation (3).
    """
    # numpy broadcasts a single stiffness to all hinges.
    return float(0.5 * np.sum(np.asarray(stiffness_Nm_per_rad) * np.asarray(phi_rad) ** 2))


def bend_held_strip(
    EI_Nm2: float, length_m: float, stations_m: Floats, angles_rad: Floats, elements: int = 400
) -> Bent:
    """Shape of least energy (7) of a strip whose tangent angles are prescribed at some stations.

    Parameters
    ----------
    EI_Nm2, length_m
        Bending stiffness and length.
    stations_m, angles_rad
        (h,) where it is held, ascending, and the angles there.
    elements
        Approximate number of elements; the error is of second order in their length.

    Returns
    -------
    Bent
        Tangent angles at the nodes, the multipliers lambda of (4), and the energy.

    Raises
    ------
    SimulationFailed
        Where Newton's iteration does not converge.

    References
    ----------
    Equation (4) with the energy (7), by Newton and Raphson.
    """
    mesh, nodes = mesh_through(EI_Nm2, length_m, np.asarray(stations_m), elements)
    angles = np.asarray(angles_rad, dtype=np.float64)
    # No force on the free end. Between stations the exact angles are near linear, and beyond them
    # constant.
    return bend(mesh, Holds(nodes, angles), np.zeros(2), np.interp(mesh.s_m, stations_m, angles))


def discrete_bending_energy_J(EI_Nm2: float, length_m: float, theta_rad: Floats) -> float:
    """Bending energy of a strip of equal elements.

    Parameters
    ----------
    EI_Nm2, length_m
        Bending stiffness and length.
    theta_rad
        (N + 1,) the tangent angles at its nodes.

    Returns
    -------
    float [J].

    References
    ----------
    Equation (7).
    """
    theta = np.asarray(theta_rad, dtype=np.float64)
    return float(0.5 * theta @ (even_mesh(EI_Nm2, length_m, theta.size - 1).stiffness @ theta))


def second_difference(
    energy_J: Callable[[Floats], float], phi_rad: Floats, step_rad: float = 1e-2
) -> Floats:
    """Equivalent stiffness of each hinge: central second differences of an energy, an error of
    second order in the step.

    Parameters
    ----------
    energy_J
        U as a function of the hinge angles (h,).
    phi_rad
        (h,) about which the hinges are perturbed.
    step_rad
        Perturbation of each.

    Returns
    -------
    (h,) [N m/rad].

    References
    ----------
    Equations (5), (6) and (8), which prints U(0) in the middle where (5) has U(phi_i).
    """
    phi = np.asarray(phi_rad, dtype=np.float64)
    middle = energy_J(phi)
    steps = step_rad * np.eye(phi.size)
    # One hinge at a time: the diagonal of the stiffness matrix, as the paper defines K_i.
    return (
        np.array([energy_J(phi + step) - 2.0 * middle + energy_J(phi - step) for step in steps])
        / step_rad**2
    )


def solve_held_contact(
    mass: Floats, force: Floats, jacobian: Floats, jacobian_rate_times_speed: Floats
) -> tuple[Floats, Floats]:
    """Accelerations and contact forces of a mechanism whose ends are held on a rigid floor.

    Parameters
    ----------
    mass, force
        M (n, n) and F (n,).
    jacobian, jacobian_rate_times_speed
        J_y (c, n), the derivative of each contact's depth, and (dJ_y/dt) q' (c,).

    Returns
    -------
    tuple
        Accelerations (n,), and lambda (c,) as in (15), M q'' + J_y^T lambda = F. Where J_y counts
        downwards, the floor would have to pull for a lambda below 0.

    References
    ----------
    Equations (14) and (15), whose lower right side lacks the dot over J_y in print.
    """
    M = np.asarray(mass, dtype=np.float64)
    J = np.atleast_2d(np.asarray(jacobian, dtype=np.float64))
    n = M.shape[0]
    held = J.shape[0]
    # The saddle-point matrix is symmetric but not definite, so a general solver is needed.
    matrix = np.block([[M, J.T], [J, np.zeros((held, held))]])
    z = np.linalg.solve(
        matrix, np.concatenate([np.asarray(force), -np.atleast_1d(jacobian_rate_times_speed)])
    )
    return z[:n], z[n:]


def effective_modulus_Pa(E1_Pa: float, nu1: float, E2_Pa: float, nu2: float) -> float:
    """Effective modulus E' of two elastic bodies in contact.

    Parameters
    ----------
    E1_Pa, E2_Pa
        Young's moduli.
    nu1, nu2
        Poisson's ratios.

    Returns
    -------
    float [Pa].

    Raises
    ------
    BadInput
        For a modulus that is not above 0, or a ratio outside -1 to 0.5.

    References
    ----------
    Equation (17), second line.
    """
    _check_positive("E1_Pa", E1_Pa)
    _check_positive("E2_Pa", E2_Pa)
    for name, nu in (("nu1", nu1), ("nu2", nu2)):
        if not -1.0 < nu <= 0.5:
            raise BadInput(
                f"{name} {nu:g}: Poisson's ratio of an isotropic body is above -1 and at "
                "most 0.5; most plastics have 0.3 to 0.45"
            )
    return 1.0 / ((1.0 - nu1**2) / E1_Pa + (1.0 - nu2**2) / E2_Pa)


def effective_radius_m(R1_m: float, R2_m: float = np.inf) -> float:
    """Effective radius R of two spheres in contact; a plane has the radius infinity, a hollow a
    negative radius.

    Parameters
    ----------
    R1_m, R2_m
        Radii of the spheres.

    Returns
    -------
    float [m].

    Raises
    ------
    BadInput
        For a first radius that is not above 0, or a hollow that is not wider than the sphere in it.
    """
    _check_positive("R1_m", R1_m)
    # A hollow must be wider than the sphere in it, or it touches along a rim instead of a point.
    # `not` also catches NaN.
    if R2_m == 0.0 or not 1.0 / R1_m + 1.0 / R2_m > 0.0:
        raise BadInput(
            f"R2_m {R2_m:g}: must be above 0, or below -R1_m = {-R1_m:g} for a hollow "
            "that is wider than the sphere"
        )
    return 1.0 / (1.0 / R1_m + 1.0 / R2_m)


def contact_radius_m(radius_m: float, depth_m: float) -> float:
    """Radius a of the circle of contact, a^2 = R depth.

    Valid for a well below R (Johnson, Contact Mechanics, 1985, section 4.2).

    Parameters
    ----------
    radius_m, depth_m
        R from `effective_radius_m`, and the approach of the bodies; 0 or less where they do not
        touch.

    Returns
    -------
    float [m].

    Raises
    ------
    BadInput
        For a radius that is not above 0, or a depth above it.

    References
    ----------
    Hertz 1881; equation (17) prints a = 2 sqrt(R) depth, which is no length.
    """
    _check_positive("radius_m", radius_m)
    if not depth_m <= radius_m:
        raise BadInput(
            f"depth_m {depth_m:g}: is above the radius, {radius_m:g} m; Hertz's law holds "
            "for depths well below it"
        )
    return float(np.sqrt(radius_m * max(depth_m, 0.0)))


def contact_stiffness_N_per_m1p5(modulus_Pa: float, radius_m: float) -> float:
    """k of N = k depth^1.5, which is 4/3 E' sqrt(R).

    Parameters
    ----------
    modulus_Pa, radius_m
        E' and R from `effective_modulus_Pa` and `effective_radius_m`.

    Returns
    -------
    float [N/m^1.5].

    Raises
    ------
    BadInput
        For a modulus or radius that is not above 0.

    References
    ----------
    Hertz 1881; Johnson, Contact Mechanics, 1985, equation (4.23).
    """
    _check_positive("modulus_Pa", modulus_Pa)
    _check_positive("radius_m", radius_m)
    return float(4.0 / 3.0 * modulus_Pa * np.sqrt(radius_m))


def contact_pressure_Pa(r_m: Floats, modulus_Pa: float, radius_m: float, depth_m: float) -> Floats:
    """Pressure at distances from the middle of the contact: p_0 sqrt(1 - r^2 / a^2), p_0 = 2 E' a /
    (pi R), and 0 beyond a.

    Parameters
    ----------
    r_m
        Distances, (m,) or any other shape.
    modulus_Pa, radius_m, depth_m
        E', R and the depth.

    Returns
    -------
    (m,) [Pa].

    Raises
    ------
    BadInput
        As `contact_radius_m`, and for a modulus that is not above 0.

    References
    ----------
    Equation (17), first line, with Hertz's p_0: the printed one does not integrate to the force.
    """
    _check_positive("modulus_Pa", modulus_Pa)
    a = contact_radius_m(radius_m, depth_m)
    if a == 0.0:
        return np.zeros_like(np.asarray(r_m, dtype=np.float64))
    inside = np.maximum(1.0 - (np.asarray(r_m) / a) ** 2, 0.0)
    return np.asarray(2.0 * modulus_Pa * a / (np.pi * radius_m) * np.sqrt(inside))


def coulomb_friction_N(speed_m_s: Floats, normal_N: Floats, coefficient: float) -> Floats:
    """Friction of a sliding contact in the direction of the speed; it acts against it. 0 at rest,
    where (19) applies.

    Parameters
    ----------
    speed_m_s, normal_N
        Of the contact, (m,) or any other shape.
    coefficient
        Kinetic coefficient of friction mu_k.

    Returns
    -------
    (m,) [N].

    References
    ----------
    Equation (18).
    """
    return np.asarray(coefficient * np.abs(normal_N) * np.sign(speed_m_s))


def stick_friction_N(
    speed_m_s: float, applied_N: float, static_N: float, kinetic_N: float
) -> float:
    """Friction of a contact that sticks as long as the applied force stays below `static_N`.

    Parameters
    ----------
    speed_m_s, applied_N
        Speed of the contact, and the tangential force of everything else.
    static_N, kinetic_N
        Limit of friction at rest, and friction in motion.

    Returns
    -------
    float [N].

    References
    ----------
    Equation (19). The simulation treats stick as a state, with a compliant tie:
    `rfca_rig.model.kernel.contact.tangential_force`.
    """
    # Exactly zero, as in (19): this function evaluates the equation and is no law for an
    # integrator.
    if speed_m_s != 0.0:
        return float(kinetic_N * np.sign(speed_m_s))
    if abs(applied_N) < static_N:
        return applied_N
    return float(static_N * np.sign(applied_N))


def _check_positive(name: str, value: float) -> None:
    # Written so that NaN is refused, too.
    if not value > 0.0:
        raise BadInput(f"{name} {value:g}: must be above 0")
