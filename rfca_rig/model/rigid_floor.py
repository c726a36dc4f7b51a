"""The tip on a rigid floor as a constraint: the equations (14)-(15) in the form of (16). Symbols as in `newton_euler`.

y_p is the depth of the tip's circle below the floor, lambda the normal force (positive upwards on the leg). The row below the mass
matrix asks J_y q'' = -(dJ_y/dt) q' (the print of (15) has lost the dot over J_y). So that rounding does not add up to a drift, it
is Baumgarte's J_y q'' = -(dJ_y/dt) q' - 2 alpha y' - alpha^2 y here, with alpha = 300 /s.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.mixed_dynamics import DrivenChain, solve_exchanged
from rfca_rig.model.newton_euler import mass_matrix, no_loads, right_side_Nm
from rfca_rig.model.statics import from_link_on

Floats = NDArray[np.float64]

ALPHA_PER_S = 300.0


@dataclass(frozen=True)
class RigidFloor:
    """A driven chain above a rigid floor. States x are those of the driven chain: angles and speeds of its free joints."""

    system: DrivenChain
    height_m: float
    radius_m: float
    mu: float

    def depths(self, phi: Floats) -> Floats:
        """y_p of every end's circle: how far it is below the floor (n,)."""
        return np.asarray(np.cumsum(self.system.chain.a * np.sin(np.cumsum(phi))) + self.radius_m - self.height_m)

    def depths_at(self, t: float, x: Floats) -> Floats:
        """The same of a state."""
        return self.depths(self.system.place(t, x)[0])

    def J_y(self, phi: Floats) -> Floats:
        """Second line of (14): depth of the tip per joint (n,)."""
        return from_link_on(self.system.chain.a * np.cos(np.cumsum(phi)))

    def J_slip(self, phi: Floats) -> Floats:
        """The same along the floor, for the circle's lowest point."""
        return from_link_on(-self.system.chain.a * np.sin(np.cumsum(phi))) - self.radius_m

    def slip(self, t: float, x: Floats) -> float:
        """Sliding speed of the tip [m/s]."""
        phi, dphi = self.system.place(t, x)
        return float(self.J_slip(phi) @ dphi)

    def lambda_row(self, phi: Floats, sliding: float) -> Floats:
        """What lambda does to the joints, friction in it: J_y + mu sgn(slip) J_slip."""
        return np.asarray(self.J_y(phi) + self.mu * sliding * self.J_slip(phi))

    def touching(self, t: float, x: Floats, sliding: float) -> tuple[Floats, float]:
        """z of (15) with the shaft's column exchanged as in (16), and lambda: torque at a prescribed joint, else acceleration."""
        phi, dphi = self.system.place(t, x)
        n, J, w = phi.size, self.J_y(phi), np.cumsum(dphi)
        A = np.zeros((n + 1, n + 1))
        A[:n, :n], A[:n, n], A[n, :n] = mass_matrix(self.system.chain, phi), self.lambda_row(phi, sliding), J
        dJ_dphi = -self.system.chain.a * np.sin(np.cumsum(phi)) @ w**2
        held = -dJ_dphi - 2.0 * ALPHA_PER_S * (J @ dphi) - ALPHA_PER_S**2 * self.depths(phi)[-1]
        known, prescribed = self.system.known(t), ~self.system.free
        tau = np.where(prescribed, 0.0, known)
        b = np.append(right_side_Nm(self.system.chain, phi, dphi, tau, no_loads(n)), held)
        z = solve_exchanged(A, b, np.append(known, 0.0), np.append(prescribed, False))
        return z[:n], float(z[n])

    def touching_rate(self, t: float, x: Floats, sliding: float) -> Floats:
        """dx/dt while the tip is held."""
        _, dphi = self.system.place(t, x)
        free = self.system.free
        return np.concatenate([dphi[free], self.touching(t, x, sliding)[0][free]])

    def after_impact(self, t: float, x: Floats, sliding: float) -> Floats:
        """x with the speed into the floor taken out of the free joints by one impulse along lambda."""
        phi, dphi = self.system.place(t, x)
        free = self.system.free
        answer = np.linalg.solve(mass_matrix(self.system.chain, phi)[np.ix_(free, free)], self.lambda_row(phi, sliding)[free])
        J = self.J_y(phi)
        return np.concatenate([phi[free], dphi[free] - answer * (J @ dphi) / (J[free] @ answer)])
