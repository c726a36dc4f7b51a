"""The paper's leg in Exudyn, another multibody code: seven bodies in absolute coordinates.

Nothing is shared with the model but the definitions in docs/model.md and the pose at rest. A link
has three coordinates, joints and the motion of the shaft are constraints with multipliers, and the
integrator is the generalized-alpha method with constant steps, of second order. Springs and contact
are symbolic functions, which Exudyn evaluates without Python.

Without friction, whose memory these functions have not. Needs the extra `comparison`.
"""

import time
from dataclasses import dataclass

import exudyn
import numpy as np
from exudyn.advancedUtilities import CreateSymbolicUserFunction
from exudyn.itemInterface import (
    CartesianSpringDamper,
    CoordinateConstraint,
    CoordinateSpringDamper,
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    NodePointGround,
    NodeRigidBody2D,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
    SensorBody,
)

from rfca_rig.model.chain import find_rest_state, make_chain
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel

symbolic = exudyn.symbolic

NEWTON_TOLERANCE = 1e-8  # Exudyn's own default
# Damping of the generalized-alpha method at high frequencies: from 1, none, to 0, all.
SPECTRAL_RADIUS = 0.8
ROTATION = 2  # of a body in the plane: x, y, angle


@dataclass(frozen=True)
class ExudynStroke:
    """The sum of the contact forces and the force on the mount (m,) at `t_s`, and the seconds that
    stepping took.
    """

    t_s: np.ndarray
    normal_N: np.ndarray
    fz_N: np.ndarray
    taken_s: float


class ExudynLeg:
    """A leg above the floor, with its shaft driven; y points up, and angles grow upwards."""

    def __init__(self, rig: RigModel, height_m: float, speed_rad_s: float) -> None:
        self.rig = rig
        self.height_m = height_m
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        rest = find_rest_state(make_chain(rig, height_m), rig.leg.start_angle_rad)
        ground = self.system.AddObject(ObjectGround())
        self.origin = self.system.AddMarker(MarkerBodyPosition(bodyNumber=ground))
        self.ends = []
        self.rotations = []
        place_m = np.zeros(2)
        for link, angle_rad in enumerate(-rest.q):
            place_m = self.add_link(link, angle_rad, place_m)
        bends_rad = np.diff(-rest.q)
        for hinge, bend_rad in enumerate(bends_rad):
            self.add_spring(hinge, float(bend_rad))
        self.drive(speed_rad_s)
        self.add_sensors()
        self.system.Assemble()

    def add_link(self, link: int, angle_rad: float, place_m: np.ndarray) -> np.ndarray:
        """A rod, hinged to the link before at `place_m` (2,), over the floor. Returns its end."""
        system = self.system
        length_m = self.rig.leg.link_lengths_m[link]
        mass_kg = self.rig.leg.link_masses_kg[link]
        direction = np.array([np.cos(angle_rad), np.sin(angle_rad)])
        middle_m = place_m + 0.5 * length_m * direction
        node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[*middle_m, angle_rad]))
        body = system.AddObject(
            ObjectRigidBody2D(mass=mass_kg, inertia=mass_kg * length_m**2 / 12.0, nodeNumber=node)
        )
        weighed = system.AddMarker(MarkerBodyMass(bodyNumber=body))
        system.AddLoad(LoadMassProportional(markerNumber=weighed, loadVector=[0, -GRAVITY_M_S2, 0]))
        begin = self.mark(body, -0.5 * length_m)
        end = self.mark(body, 0.5 * length_m)
        before = self.ends[-1][1] if self.ends else self.origin
        system.AddObject(ObjectJointRevolute2D(markerNumbers=[before, begin]))
        self.ends.append((body, end))
        self.rotations.append(
            system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=ROTATION))
        )
        self.add_floor(end)
        return place_m + length_m * direction

    def mark(self, body: object, along_m: float) -> object:
        """A marker on the line of a rod."""
        return self.system.AddMarker(
            MarkerBodyPosition(bodyNumber=body, localPosition=[along_m, 0, 0])
        )

    def add_floor(self, end: object) -> None:
        """Hertz contact with damping under a link's end."""
        ground = self.rig.ground
        radius_m = self.rig.leg.link_radius_m
        stiffness_N_per_m1p5 = ground.stiffness_N_per_m1p5
        falling = symbolic.Real(ground.damping_s_per_m)
        rising = symbolic.Real(ground.damping_s_per_m * ground.leaving_damping_share)
        height_m = self.height_m

        def push(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):
            depth = symbolic.max(radius_m - displacement[1] - height_m, 0.0)
            speed = velocity[1]
            damped = symbolic.IfThenElse(speed < 0.0, falling, rising)
            elastic = stiffness_N_per_m1p5 * symbolic.pow(depth, 1.5)
            return [0.0, -1.0 * elastic * symbolic.max(1.0 - damped * speed, 0.0), 0.0]

        self.add_law(
            CartesianSpringDamper(markerNumbers=[self.origin, end], stiffness=[0, 1, 0]),
            springForceUserFunction=push,
        )

    def add_spring(self, hinge: int, bend_rad: float) -> None:
        """The spring and damper between two links, bent at rest by `bend_rad`."""
        leg = self.rig.leg
        hardening = leg.k2_per_rad2

        def resist(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):
            bend = displacement + offset
            return stiffness * bend * (1.0 + hardening * bend * bend) + damping * velocity

        self.add_law(
            CoordinateSpringDamper(
                markerNumbers=self.rotations[hinge : hinge + 2],
                stiffness=leg.k0_Nm_per_rad,
                damping=leg.hinge_damping_Nm_s_per_rad,
                offset=bend_rad,
            ),
            springForceUserFunction=resist,
        )

    def drive(self, speed_rad_s: float) -> None:
        """Prescribes the angle of the first link: an even ramp to the speed, downwards."""
        ramp_s = self.rig.drive.ramp_s

        def turn(mbs, t, itemNumber, lOffset):
            ramp = 0.5 * speed_rad_s / ramp_s * t * t
            return -1.0 * symbolic.IfThenElse(t < ramp_s, ramp, speed_rad_s * (t - 0.5 * ramp_s))

        def turn_speed(mbs, t, itemNumber, lOffset):
            ramp = speed_rad_s / ramp_s * t
            return -1.0 * symbolic.IfThenElse(t < ramp_s, ramp, symbolic.Real(speed_rad_s))

        node = self.system.AddNode(NodePointGround())
        still = self.system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        self.add_law(
            CoordinateConstraint(markerNumbers=[still, self.rotations[0]]),
            offsetUserFunction=turn,
            offsetUserFunction_t=turn_speed,
        )

    def add_law(self, item: object, **functions: object) -> None:
        """Adds an item whose laws Exudyn translates once, so that no step calls Python."""
        number = self.system.AddObject(item)
        for name, function in functions.items():
            law = CreateSymbolicUserFunction(self.system, function, name, number)
            self.system.SetObjectParameter(number, name, law)

    def add_sensors(self) -> None:
        """Places and speeds of the link ends, and the accelerations of the centres of mass."""
        outputs = exudyn.OutputVariableType
        self.places = []
        self.speeds = []
        self.accelerations = []
        for (body, _), length_m in zip(self.ends, self.rig.leg.link_lengths_m, strict=True):
            self.places.append(self.sense(body, 0.5 * length_m, outputs.Position))
            self.speeds.append(self.sense(body, 0.5 * length_m, outputs.Velocity))
            self.accelerations.append(self.sense(body, 0.0, outputs.Acceleration))

    def sense(self, body: object, along_m: float, output: object) -> object:
        """A sensor on the line of a rod, which keeps its values."""
        return self.system.AddSensor(
            SensorBody(
                bodyNumber=body,
                localPosition=[along_m, 0, 0],
                storeInternal=True,
                outputVariableType=output,
            )
        )

    def simulate(self, end_s: float, step_s: float, sampled_s: float) -> ExudynStroke:
        """The stroke with constant steps. Raises exudyn.SolverError where Newton's method fails."""
        settings = exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps = round(end_s / step_s)
        integration.endTime = end_s
        integration.verboseMode = 0
        integration.adaptiveStep = False
        integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        integration.newton.relativeTolerance = NEWTON_TOLERANCE
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = sampled_s
        began = time.perf_counter()
        self.system.SolveDynamic(settings)
        taken_s = time.perf_counter() - began
        normal_N = self.sum_contact()
        t_s = self.system.GetSensorStoredData(self.places[0])[:, 0]
        return ExudynStroke(t_s, normal_N, self.sum_weight_and_inertia() - normal_N, taken_s)

    def sum_weight_and_inertia(self) -> np.ndarray:
        """What mount and floor carry together (m,), by Newton's law for the whole leg."""
        total_N = 0.0
        for acceleration, mass_kg in zip(
            self.accelerations, self.rig.leg.link_masses_kg, strict=True
        ):
            up_m_s2 = self.read_upward(acceleration)
            total_N = total_N + mass_kg * (GRAVITY_M_S2 + up_m_s2)
        return np.asarray(total_N)

    def sum_contact(self) -> np.ndarray:
        """The floor's force (m,), from the stored places and speeds of all link ends."""
        ground = self.rig.ground
        total_N = 0.0
        for place, speed in zip(self.places, self.speeds, strict=True):
            y_m = self.read_upward(place)
            v_m_s = self.read_upward(speed)
            share = np.where(v_m_s < 0.0, 1.0, ground.leaving_damping_share)
            depth_m = np.maximum(self.rig.leg.link_radius_m - y_m - self.height_m, 0.0)
            damped = np.maximum(1.0 - ground.damping_s_per_m * share * v_m_s, 0.0)
            total_N = total_N + ground.stiffness_N_per_m1p5 * depth_m**1.5 * damped
        return np.asarray(total_N)

    def read_upward(self, sensor: object) -> np.ndarray:
        """The y component (m,) of a sensor's values, behind time and x."""
        return self.system.GetSensorStoredData(sensor)[:, 2]
