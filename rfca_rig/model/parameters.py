"""Parameters of the nominal model: leg, ground, sensor mount, drive and effects. SI units,
frozen.
"""

from dataclasses import dataclass

GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class TorqueSpline:
    """A measured torque over the angle of a hinge from rest, (0, 0) among its knots; see
    `hinge_springs`.

    `torques_rad` are divided by k0 of the leg, so that k0 scales the curve. Angles that begin at 0
    hold for both sides.
    """

    angles_rad: tuple[float, ...]
    torques_rad: tuple[float, ...]

    def scaled(self, angle: float, torque: float) -> "TorqueSpline":
        """The curve with its angles and torques multiplied by these factors."""
        return TorqueSpline(
            tuple(angle * value for value in self.angles_rad),
            tuple(torque * value for value in self.torques_rad),
        )


@dataclass(frozen=True)
class Leg:
    """A chain of straight uniform links; hinge torque k0 phi + k0 k2 phi^3 + c dphi/dt (paper-style
    hardening spring).

    `start_angle_rad` is the shaft angle where a stroke begins, from the horizontal, positive
    downwards. `rest_angles_rad` are the angles of the hinges without load, phi_i0 of eq. (12), from
    which phi counts; without them the leg is straight.

    `torque_splines`, one for all hinges or one for each, replace k0 phi + k0 k2 phi^3: the torque
    is then k0 times the spline, k0 is the stiffness at rest (the mean of all hinges), and k2 is 0
    and unused.
    """

    link_lengths_m: tuple[float, ...]
    link_masses_kg: tuple[float, ...]
    link_radius_m: float
    k0_Nm_per_rad: float
    k2_per_rad2: float
    hinge_damping_Nm_s_per_rad: float
    start_angle_rad: float
    rest_angles_rad: tuple[float, ...] = ()
    torque_splines: tuple[TorqueSpline, ...] = ()


@dataclass(frozen=True)
class Ground:
    """A level floor: normal force stiffness * depth^1.5 * (1 + damping * approach speed), Coulomb
    friction with stick.

    Two parameters describe the tangential compliance: a sticking point yields in proportion to the
    force, by `presliding` at the limit mu N. `drag` is a viscous force in addition to the Coulomb
    force, in full from a normal force of 1 N on. Friction acts with the `friction_lever` about a
    link's end: None for the radius of the tip, since friction acts at the circle's lowest point.
    Where a tip is deep in the floor, friction may act higher: by `friction_rise_share` of the
    depth, where 1 is the floor's surface. The damping of a tip that leaves is
    `leaving_damping_share` of that of a tip that enters.
    """

    stiffness_N_per_m1p5: float
    damping_s_per_m: float
    friction_coefficient: float
    presliding_m: float
    drag_N_s_per_m: float
    friction_lever_m: float | None = None
    friction_rise_share: float = 0.0
    leaving_damping_share: float = 1.0


@dataclass(frozen=True)
class SensorMount:
    """Where the force sensor sits: tx = shaft torque + below_shaft * fy."""

    below_shaft_m: float


@dataclass(frozen=True)
class Drive:
    """Start-up of the drive: the speed rises linearly from rest to its command within `ramp_s`.

    `holds_start` concerns only a compliant drive. If true, its integrator carries the weight of the
    leg at the start, and the shaft rests at its commanded angle; otherwise it rests where its angle
    gain carries the weight.
    """

    ramp_s: float
    holds_start: bool = False


@dataclass(frozen=True)
class LawTable:
    """A force as a function of one argument: straight lines between `values` at ascending `knots`,
    constant beyond both ends.

    It acts at `place` and depends on `argument`; `tabulated_law` lists both, with units.
    """

    place: str
    argument: str
    knots: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class PresentEffect:
    """An effect that acts in this rig: its id in the catalogue, and the values of its parameters in
    the units of their names.

    A tabulated law is not in the catalogue: it has a `table` in place of values.
    """

    id: str
    values: tuple[tuple[str, float], ...] = ()
    table: LawTable | None = None


@dataclass(frozen=True)
class Swing:
    """Initial oscillation of the leg, `before_s` before the start of the stroke.

    The leg is above its rest pose by `share` of its sag (1 is straight), and rises by `rate_per_s`
    sags per second. A leg that was held straight and released some time ago swings like that.
    """

    before_s: float
    share: float
    rate_per_s: float


@dataclass(frozen=True)
class RigModel:
    """Model of one rig. `effects` are applied in their order; () is the plain model. Without
    `swing` a stroke begins at rest.
    """

    leg: Leg
    ground: Ground
    sensor: SensorMount
    drive: Drive
    effects: tuple[PresentEffect, ...] = ()
    swing: Swing | None = None

    @property
    def friction_lever_m(self) -> float:
        """The lever of friction about the end of a link."""
        lever_m = self.ground.friction_lever_m
        if lever_m is None:
            return self.leg.link_radius_m
        return lever_m
