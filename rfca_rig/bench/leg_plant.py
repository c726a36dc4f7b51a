"""Mechanics of the twins: the model's chain, with the shaft driven by the torque of the motor
twin.
"""

from dataclasses import dataclass, field
from itertools import accumulate
from math import sin
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import resolve_effect, set_up
from rfca_rig.model.chain import (
    HELD_SHAFT,
    Tolerance,
    advance,
    allocate_samples,
    find_rest_state,
    resolve_integrator,
)
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import Chain, Laws, Samples, Shaft, State, Work
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.setup import Setup
from rfca_rig.twins.world import ShaftDrive, ShaftState

Floats = NDArray[np.float64]

TOLERANCE = Tolerance()

# Longer than a bounce: after it, a contact counts as a new touchdown with new friction.
IN_THE_AIR_S = 0.2

NO_WRENCH = np.empty((0, 6))


@dataclass(frozen=True)
class TwinScatter:
    """Standard deviations between repeats: floor friction at each touchdown, height at each
    setting.
    """

    friction: float = 0.0
    height_m: float = 0.0


def set_up_mechanics(rig: RigModel, height_m: float, shaft_angle_rad: float) -> Setup:
    """The leg with its shaft held, and its surroundings.

    Raises BadInput for effects that the mechanics of a twin cannot have.
    """
    still = ramp_to_speed(shaft_angle_rad, 0.0, 1.0, 1.0)
    setup = set_up(rig, height_m, still)
    # The twins simulate drive and sensor themselves, so effects that act there have no place in
    # this model.
    if setup.drive is not None or setup.sensor_changes or setup.motion is not still:
        raise BadInput(
            "the twin has a drive and a sensor of its own; leave effects that act "
            "there out of its rig file"
        )
    for effect, _ in map(resolve_effect, rig.effects):
        if effect.needs_order:
            raise BadInput(
                f"effect {effect.id}: the twin does not count its strokes; leave it "
                "out of its rig file"
            )
    return setup


@dataclass
class LegPlant:
    """Implements twins.world.TwinPlant, and twins.camera.StandingLeg.

    `rotor_inertia_kg_m2` is the drive's, at the shaft; `random` decides the scatter.
    """

    rig: RigModel
    height_m: float
    shaft_angle_rad: float
    rotor_inertia_kg_m2: float
    scatter: TwinScatter
    random: np.random.Generator
    _now_s: float = 0.0
    _step_s: float = 1e-4
    _airborne_s: float = 0.0
    _chain: Chain = field(init=False)
    _laws: Laws = field(init=False)
    _state: State = field(init=False)
    _work: Work = field(init=False)
    _integrator: Any = field(init=False)
    _samples: dict[int, Samples] = field(init=False)
    _shaft_state: ShaftState = field(init=False)
    _torque_Nm: float = 0.0

    def __post_init__(self) -> None:
        self._stand(self.shaft_angle_rad, self.height_m)

    def _stand(self, shaft_angle_rad: float, height_m: float) -> None:
        """Resets the leg: hanging at rest, at this height. Where it has no rest pose there, it
        stays as it is.
        """
        setup = set_up_mechanics(self.rig, height_m, shaft_angle_rad)
        chain = setup.chain()
        laws = setup.compile_laws(chain)
        self._state = find_rest_state(chain, shaft_angle_rad, laws)
        self.height_m = height_m
        self._chain = chain
        self._laws = laws
        # Kept from step to step: new memory takes longer than the integration of a step.
        self._work = allocate_workspace(self._state.q.size, self._state.anchor.size)
        self._samples = {}
        # The types stay until the next setting, so they are looked at here and not at every step.
        arguments = (
            self._chain,
            self._laws,
            self._shaft(ShaftDrive()),
            self._state,
            self._work,
            self._outputs(np.empty(0)),
        )
        self._integrator = resolve_integrator(*arguments)
        self._shaft_state = self._read_shaft()

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Moves on to `to_s` and returns the wrench at the sensor.

        Parameters
        ----------
        to_s : float
            End of the step, s.
        drive : ShaftDrive
            Feedback law of the motor, held constant during the step.
        force_times_s : ndarray, shape (m,)
            Times in s within the step.

        Returns
        -------
        ndarray, shape (m, 6)
            Force in N and moment in N m at `force_times_s`; out-of-plane components are zero.
        """
        samples = self._outputs(force_times_s)
        span_s = (self._now_s, to_s)
        shaft = self._shaft(drive)
        cost = advance(
            self._chain,
            shaft,
            self._state,
            span_s,
            self._step_s,
            TOLERANCE,
            samples,
            self._laws,
            self._work,
            self._integrator,
        )
        # The integrator's last step width is the best guess for the next call.
        self._step_s = cost.next_s
        if self._deepest_m() < self._chain.ground_depth:
            self._airborne_s += to_s - self._now_s
        elif self._airborne_s > IN_THE_AIR_S:
            self._airborne_s = 0.0
            friction = (
                self.rig.ground.friction_coefficient
                + self.scatter.friction * self.random.standard_normal()
            )
            # Cut off at zero: with a large scatter, the normal distribution reaches negative
            # friction.
            self._chain = self._chain._replace(mu=max(friction, 0.0))
        self._now_s = to_s
        # At the end of the step: what the drive reports until the next one.
        self._torque_Nm = drive.torque_Nm(self._state.q.item(0), self._state.w.item(0))
        self._shaft_state = self._read_shaft()
        if len(force_times_s):
            return self._wrench(samples.force)
        return NO_WRENCH

    def _outputs(self, times_s: Floats) -> Samples:
        """Arrays for the samples at these times, used again by every step with as many."""
        samples = self._samples.get(len(times_s))
        if samples is None:
            samples = self._samples[len(times_s)] = allocate_samples(
                times_s, self._state.q.size, self._state.anchor.size
            )
        return Samples(times_s, *samples[1:])

    def _shaft(self, drive: ShaftDrive) -> Shaft:
        # Both have feed, gain and value of the angle, gain and value of the speed, in this order;
        # names would take twice the time.
        return Shaft(
            HELD_SHAFT.breaks,
            HELD_SHAFT.coefficient,
            HELD_SHAFT.landings,
            True,
            self.rotor_inertia_kg_m2,
            *drive,
        )

    def _wrench(self, force: Floats) -> Floats:
        wrench = np.zeros((len(force), 6))
        wrench[:, 1:4] = force
        # Moment about the shaft, moved to the sensor's origin, which is `below_shaft_m` lower.
        wrench[:, 3] += self.rig.sensor.below_shaft_m * force[:, 0]
        return wrench

    def _deepest_m(self) -> float:
        depths_m = accumulate(
            map(mul, self.rig.leg.link_lengths_m, map(sin, self._state.q.tolist()))
        )
        return float(max(0.0, *depths_m)) + self.rig.leg.link_radius_m

    def shaft(self) -> ShaftState:
        return self._shaft_state

    def _read_shaft(self) -> ShaftState:
        return ShaftState(self._state.q.item(0), self._state.w.item(0), self._torque_Nm)

    def link_angles_rad(self) -> Floats:
        """Angles (n,) of the links from the horizontal, rad."""
        return np.array(self._state.q[: len(self.rig.leg.link_lengths_m)])

    def link_lengths_m(self) -> Floats:
        """Lengths (n,) of the links, m."""
        return np.array(self.rig.leg.link_lengths_m)

    def ground_depth_m(self) -> float:
        return self.height_m

    def set_height(self, height_m: float) -> None:
        """Sets the height in m, within the scatter of a hand on the lead screws.

        Raises SimulationFailed where the leg has no rest pose there; the height stays as before.
        """
        scattered_m = height_m + self.scatter.height_m * self.random.standard_normal()
        self._stand(float(self._state.q[0]), scattered_m)
