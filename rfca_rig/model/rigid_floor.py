"""The tip on a rigid floor as a constraint: the equations (14)-(15) in the form of (16). Symbols as in `newton_euler`.

y_p is the depth of the tip's circle below the floor, lambda the normal force (positive upwards on the leg). The row below the mass
matrix requires J_y q'' = -(dJ_y/dt) q' (the print of (15) has lost the dot over J_y). Rounding would add up to a drift, so it
is stabilised as by Baumgarte: J_y q'' = -(dJ_y/dt) q' - 2 alpha y' - alpha^2 y, with alpha = 300 /s.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.mixed_dynamics import DrivenChain, solve_exchanged
from rfca_rig.model.newton_euler import mass_matrix, no_loads, right_side_Nm
from rfca_rig.model.statics import sum_to_tip

Floats = NDArray[np.float64]

# Baumgarte's alpha: an error of the constraint decays with a time constant of 3.3 ms, critically damped.
ALPHA_PER_S = 300.0


@dataclass(frozen=True)
class RigidFloor:
    """A driven chain above a rigid floor. States x (2 f,) are those of the driven chain: angles and speeds of its f free joints.

    `sliding` is the direction of the tip's slip, -1, 0 or 1; `mu` is the friction coefficient.
    """

    system: DrivenChain
    height_m: float
    radius_m: float
    mu: float

    def depths(self, phi: Floats) -> Floats:
        """y_p of every end's circle: how far it is below the floor (n,)."""
        return np.asarray(np.cumsum(self.system.chain.a * np.sin(np.cumsum(phi))) + self.radius_m - self.height_m)

    def depths_at(self, t: float, x: Floats) -> Floats:
        """The same (n,) for a state."""
        return self.depths(self.system.place(t, x)[0])

    def J_y(self, phi: Floats) -> Floats:
        """Second line of (14): derivative (n,) of the tip's depth by each joint angle [m/rad]."""
        return sum_to_tip(self.system.chain.a * np.cos(np.cumsum(phi)))

    def J_slip(self, phi: Floats) -> Floats:
        """The same along the floor, for the circle's lowest point."""
        return sum_to_tip(-self.system.chain.a * np.sin(np.cumsum(phi))) - self.radius_m

    def slip(self, t: float, x: Floats) -> float:
        """Sliding speed of the tip [m/s]."""
        phi, dphi = self.system.place(t, x)
        return float(self.J_slip(phi) @ dphi)

    def lambda_row(self, phi: Floats, sliding: float) -> Floats:
        """Joint torques (n,) per unit of lambda, with friction: J_y + mu sgn(slip) J_slip."""
        return np.asarray(self.J_y(phi) + self.mu * sliding * self.J_slip(phi))

    def touching(self, t: float, x: Floats, sliding: float) -> tuple[Floats, float]:
        """Solves (15) with the columns of prescribed joints exchanged as in (16): z (n,) and lambda.

        z holds the torque of a prescribed joint, and the acceleration of any other.
        """
        phi, dphi = self.system.place(t, x)
        n, J, w = phi.size, self.J_y(phi), np.cumsum(dphi)
        A = np.zeros((n + 1, n + 1))
        # Column and row differ where there is friction: it acts on the joints, but is not part of the constraint.
        A[:n, :n], A[:n, n], A[n, :n] = mass_matrix(self.system.chain, phi), self.lambda_row(phi, sliding), J
        dJ_dphi = -self.system.chain.a * np.sin(np.cumsum(phi)) @ w**2
        held = -dJ_dphi - 2.0 * ALPHA_PER_S * (J @ dphi) - ALPHA_PER_S**2 * self.depths(phi)[-1]
        known, prescribed = self.system.known(t), ~self.system.free
        tau = np.where(prescribed, 0.0, known)
        b = np.append(right_side_Nm(self.system.chain, phi, dphi, tau, no_loads(n)), held)
        z = solve_exchanged(A, b, np.append(known, 0.0), np.append(prescribed, False))
        return z[:n], float(z[n])

    def contact_rate(self, t: float, x: Floats, sliding: float) -> Floats:
        """dx/dt (2 f,) while the tip is held."""
        _, dphi = self.system.place(t, x)
        free = self.system.free
        return np.concatenate([dphi[free], self.touching(t, x, sliding)[0][free]])

    def apply_impact(self, t: float, x: Floats, sliding: float) -> Floats:
        """State (2 f,) after a plastic impact: one impulse along lambda on the free joints removes the tip's speed into the floor."""
        phi, dphi = self.system.place(t, x)
        free = self.system.free
        # Change of the free speeds per unit of impulse; a prescribed joint does not change its speed.
        change = np.linalg.solve(mass_matrix(self.system.chain, phi)[np.ix_(free, free)], self.lambda_row(phi, sliding)[free])
        J = self.J_y(phi)
        return np.concatenate([phi[free], dphi[free] - change * (J @ dphi) / (J[free] @ change)])
