"""A pendulum of one or two links, simulated by SciPy from its Lagrangian, independent of the
package's model.

Angles count from the hanging position, the second from the direction of the first link. Dry
friction is regularised: a joint at rest creeps, where the package's model sticks. All laws are more
general than the catalogue's: exponents and the form of the sign are free.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

Floats = NDArray[np.float64]

G_M_S2 = 9.81
# Several steps within the shortest period of a command.
MAX_STEP_S = 0.05


@dataclass(frozen=True)
class Tones:
    """A torque for every joint, as a sum of sines: `size` in N m, `omega` in rad/s and `phase`
    in rad, (tones, n) each.
    """

    size: Floats
    omega: Floats
    phase: Floats

    def at(self, t_s: float) -> Floats:
        """The torques (n,) in N m at a time."""
        return np.asarray((self.size * np.sin(self.omega * t_s + self.phase)).sum(axis=0))

    def later(self, delay_s: float, lag_s: float) -> "Tones":
        """The steady-state torques after a dead time and a first-order lag."""
        # The gain of the lag, 1 / sqrt(1 + (omega lag)^2), is the cosine of its phase.
        turn = np.arctan(self.omega * lag_s)
        return Tones(self.size * np.cos(turn), self.omega, self.phase - self.omega * delay_s - turn)


@dataclass(frozen=True)
class Friction:
    """Friction of a joint: its size and its form.

    `dry_Nm` is one value per joint. It is larger by `rise` at rest and falls over the speed
    `rise_rad_s`, with the exponent `rise_power`. `loss` is a share of the motor's torque to the
    power `loss_power`, relative to `loss_at_Nm`. `backward` scales dry friction at negative speed.
    `sign_rad_s` is the speed at which the regularised sign is about 1, `sign` its form.
    """

    dry_Nm: tuple[float, ...] = (0.0, 0.0)
    rise: float = 0.0
    rise_rad_s: float = 1.0
    rise_power: float = 1.0
    loss: float = 0.0
    loss_power: float = 1.0
    loss_at_Nm: float = 1.0
    backward: float = 1.0
    sign_rad_s: float = 5e-3
    sign: str = "tanh"

    def torque_Nm(self, speed_rad_s: Floats, motor_Nm: Floats) -> Floats:
        """Friction torque (n,) in N m, of the sign of the speed (n,); `motor_Nm` (n,) is the
        motors' torque.
        """
        u = speed_rad_s / self.sign_rad_s
        n = len(speed_rad_s)
        if self.sign == "tanh":
            sign = np.tanh(u)
        elif self.sign == "root":
            sign = u / np.hypot(1.0, u)
        else:
            sign = 2.0 / np.pi * np.arctan(u)
        fall = 1.0 + self.rise * np.exp(
            -((np.abs(speed_rad_s) / self.rise_rad_s) ** self.rise_power)
        )
        dry = np.array(self.dry_Nm[:n]) * fall * np.where(speed_rad_s < 0.0, self.backward, 1.0)
        return np.asarray(
            sign
            * (
                dry
                + self.loss
                * self.loss_at_Nm
                * (np.abs(motor_Nm) / self.loss_at_Nm) ** self.loss_power
            )
        )


@dataclass(frozen=True)
class PendulumWorld:
    """The true rig. Tuples hold one value per link or joint; n is their number.

    - Inertia: `inertia_kg_m2` is about the joint, `rotor_kg_m2` in every joint.
    - Drag: acts at the middle of each link, across it, with the exponent `drag_power` of the speed.
    - Motors: give `torque_scale` times the sum of recorded torque and `torque_offset_Nm`, later by
      `torque_delay_s` and a lag. They saturate smoothly at `saturates_at_Nm` and have cogging with
      `cogging_cycles` per turn.
    - `spring_Nm_per_rad`: a cable at the first joint.
    - Readings: zero offset, a lag of angles and speeds together, a lag of speeds alone.
    """

    length_m: tuple[float, ...]
    mass_kg: tuple[float, ...]
    centre_m: tuple[float, ...]
    inertia_kg_m2: tuple[float, ...]
    damping_Nm_s_per_rad: tuple[float, ...]
    friction: Friction = field(default=Friction())
    rotor_kg_m2: float = 0.0
    tip_mass_kg: float = 0.0
    drag_N_s2_per_m3: float = 0.0
    drag_power: float = 2.0
    tilt_rad: float = 0.0
    spring_Nm_per_rad: float = 0.0
    torque_scale: float = 1.0
    torque_offset_Nm: tuple[float, ...] = (0.0, 0.0)
    torque_delay_s: float = 0.0
    torque_lag_s: float = 0.0
    saturates_at_Nm: float = np.inf
    cogging_Nm: float = 0.0
    cogging_cycles: float = 7.0
    angle_zero_rad: tuple[float, ...] = (0.0, 0.0)
    angle_lag_s: float = 0.0
    speed_lag_s: float = 0.0

    @property
    def joints(self) -> int:
        return len(self.length_m)

    def inertia_and_rest(self, angle: Floats, speed: Floats) -> tuple[Floats, Floats]:
        """Mass matrix (n, n) and generalised torques without those of the joints (n,), in
        absolute angles (n,).
        """
        masses = np.array([*self.mass_kg[:-1], self.mass_kg[-1] + self.tip_mass_kg])
        moments = np.multiply(self.mass_kg, self.centre_m)
        moments[-1] += self.tip_mass_kg * self.length_m[-1]
        inertias = np.array(self.inertia_kg_m2)
        inertias[-1] += self.tip_mass_kg * self.length_m[-1] ** 2
        lean = np.sin(angle + self.tilt_rad)
        if self.joints == 1:
            return np.array([[inertias[0] + self.rotor_kg_m2]]), -G_M_S2 * moments * lean
        between = angle[0] - angle[1]
        coupling = moments[1] * self.length_m[0]
        cross = coupling * np.cos(between)
        rotor = self.rotor_kg_m2
        matrix = np.array(
            [[inertias[0] + masses[1] * self.length_m[0] ** 2, cross], [cross, inertias[1]]]
        )
        # The second rotor turns with the relative angle of the joint.
        matrix += rotor * np.array([[2.0, -1.0], [-1.0, 1.0]])
        turning = coupling * np.sin(between) * np.array([-(speed[1] ** 2), speed[0] ** 2])
        weight = -G_M_S2 * np.array([moments[0] + masses[1] * self.length_m[0], moments[1]]) * lean
        return matrix, turning + weight

    def drag_Nm(self, angle: Floats, speed: Floats) -> Floats:
        """Generalised drag torques (n,) in N m on the absolute angles (n,), at speeds (n,)."""
        half = 0.5 * self.length_m[-1]
        if self.joints == 1:
            return np.array([half * self._across(self.length_m[0], half * speed[0])])
        first = 0.5 * self.length_m[0]
        turned = np.cos(angle[0] - angle[1])
        on_second = self._across(
            self.length_m[1], self.length_m[0] * speed[0] * turned + half * speed[1]
        )
        on_first = self._across(self.length_m[0], first * speed[0])
        return np.array(
            [first * on_first + self.length_m[0] * turned * on_second, half * on_second]
        )

    def _across(self, length_m: float, speed_m_s: float) -> float:
        return float(
            -self.drag_N_s2_per_m3
            * length_m
            * np.sign(speed_m_s)
            * abs(speed_m_s) ** self.drag_power
        )


@dataclass(frozen=True)
class PendulumTrace:
    """Recorded columns: times (m,); joint angles and speeds as read and torques as recorded, (m,
    n) each; the true state (m, 2 n).
    """

    t_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats
    torque_Nm: Floats
    state: Floats


def swing(
    world: PendulumWorld, start: Floats, command: Tones, t_s: Floats, driven: bool = True
) -> PendulumTrace:
    """Simulate the motion from joint angles and speeds `start` (2 n,) at t_s[0] under commanded
    torques, read without noise.

    `t_s` (m,) is evenly spaced. The integrator is LSODA with a relative tolerance of 1e-7.
    """
    n = world.joints
    to_absolute = np.tril(np.ones((n, n)))
    to_joint = np.linalg.inv(to_absolute)
    offset = np.array(world.torque_offset_Nm[:n])
    made = command.later(world.torque_delay_s, world.torque_lag_s)

    def rates(t: float, x: Floats) -> Floats:
        angle, speed = x.reshape(2, n)
        absolute = to_absolute @ angle
        turning = to_absolute @ speed
        if driven:
            torque = world.torque_scale * (made.at(t) + offset)
        else:
            torque = np.zeros(n)
        if np.isfinite(world.saturates_at_Nm):
            torque = world.saturates_at_Nm * np.tanh(torque / world.saturates_at_Nm)
        joint = (
            torque
            - world.friction.torque_Nm(speed, torque)
            - np.array(world.damping_Nm_s_per_rad) * speed
        )
        joint[0] -= world.spring_Nm_per_rad * angle[0] + world.cogging_Nm * np.sin(
            world.cogging_cycles * angle[0]
        )
        matrix, rest = world.inertia_and_rest(absolute, turning)
        acceleration = np.linalg.solve(
            matrix, rest + world.drag_Nm(absolute, turning) + to_joint.T @ joint
        )
        return np.concatenate([speed, to_joint @ acceleration])

    state = solve_ivp(
        rates, (t_s[0], t_s[-1]), start, "LSODA", t_s, rtol=1e-7, atol=1e-9, max_step=MAX_STEP_S
    ).y.T
    if driven:
        recorded = np.array([command.at(t) for t in t_s])
    else:
        recorded = np.zeros((len(t_s), n))
    step_s = float(t_s[1] - t_s[0])
    # With the same past for both, the speed that is read is the derivative of the angle that is
    # read.
    acceleration = (state[1, n:] - state[0, n:]) / step_s
    angle = _lag(state[:, :n], world.angle_lag_s, step_s, acceleration) + np.array(
        world.angle_zero_rad[:n]
    )
    speed = _lag(_lag(state[:, n:], world.angle_lag_s, step_s), world.speed_lag_s, step_s)
    return PendulumTrace(t_s, angle, speed, recorded, state)


def _lag(x: Floats, lag_s: float, step_s: float, curvature: Floats | float = 0.0) -> Floats:
    """First-order lag, lag y' = x - y, of columns (m, n) that are linear between samples; exact for
    such columns.

    Before the first sample x is extended with its first slope and the `curvature` (n,).
    """
    if lag_s <= 0.0:
        return x
    a = np.exp(-step_s / lag_s)
    new = 1.0 - lag_s * (1.0 - a) / step_s
    # The steady response to x + v t + c t^2 / 2 is x - lag v + lag^2 c at t = 0.
    slope = (x[1] - x[0]) / step_s - 0.5 * step_s * curvature
    begin = x[0] - lag_s * slope + lag_s**2 * curvature
    return np.asarray(
        lfilter(
            [new, 1.0 - a - new],
            [1.0, -a],
            x - begin,
            axis=0,
            zi=np.atleast_2d(-new * (x[0] - begin)),
        )[0]
        + begin
    )
