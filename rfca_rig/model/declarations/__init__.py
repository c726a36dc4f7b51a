"""The effects of the package, each declared once, without their laws as code.

They are imported in milliseconds: what lists effects needs no simulator. `rfca_rig.model.effects`
has the laws of a leg, `rfca_rig.mechanism.effects` those of a mechanism.
"""

from collections.abc import Iterable, Iterator

from rfca_rig.model.declarations import drive, ground, hinges, joints, rig, sensor
from rfca_rig.model.effect import Declaration

LEG = (
    hinges.HINGE_COULOMB_FRICTION,
    hinges.HINGE_VISCOUS_DAMPING,
    hinges.HINGE_QUADRATIC_DAMPING,
    hinges.SPRING_HYSTERESIS,
    hinges.SPRING_RELAXATION,
    hinges.DAMAGED_HINGE,
    hinges.HINGE_BACKLASH,
    hinges.HINGE_STOP,
    hinges.HINGE_REST_ANGLE,
    hinges.HINGE_REST_ANGLE_OF_ONE,
    hinges.STIFFNESS_HARDENING,
    hinges.STIFFNESS_FADING,
    ground.GROUND_COMPLIANCE,
    ground.GROUND_EXPONENT,
    ground.GROUND_STRIBECK,
    ground.GROUND_ADHESION,
    ground.GROUND_TILT,
    ground.GROUND_BUMP,
    ground.HEIGHT_OFFSET,
    drive.MOTOR_SPEED_DROOP,
    drive.MOTOR_TORQUE_LIMIT,
    drive.MOTOR_COGGING,
    drive.MOTOR_SPEED_RIPPLE,
    drive.SHAFT_COMPLIANCE,
    drive.SHAFT_PLAY,
    drive.SHAFT_FRICTION,
    rig.TIP_MASS,
    rig.HEAVIER_LINK,
    rig.FRAME_COMPLIANCE,
    rig.GRAVITY_TILT,
    rig.FLUID_DRAG,
    sensor.SENSOR_GAIN,
    sensor.SENSOR_CROSSTALK,
    sensor.SENSOR_CROSSTALK_MATRIX,
    sensor.SENSOR_SATURATION,
    sensor.SENSOR_DRIFT,
    sensor.SENSOR_LAG,
    sensor.SENSOR_RINGING,
    sensor.CLOCK_OFFSET,
    sensor.SENSOR_CLOCK_RATE,
)


def _with_single(declarations: Iterable[Declaration]) -> Iterator[Declaration]:
    """The declarations, each with that of its law in one joint, actuator or sensor behind it."""
    for declaration in declarations:
        yield declaration
        if declaration.single:
            yield declaration.of_one()


# Which of them a mechanism may lack, and their sizes, depend on its model file and recordings.
MECHANISM = tuple(
    _with_single(
        (
            joints.JOINT_FRICTION,
            joints.JOINT_STRIBECK,
            joints.JOINT_HYSTERESIS,
            joints.JOINT_LOAD_FRICTION,
            joints.GEAR_COMPLIANCE,
            joints.GEAR_BACKLASH,
            joints.JOINT_DAMPING,
            joints.JOINT_DRAG,
            joints.JOINT_INERTIA,
            joints.JOINT_SPRING,
            joints.JOINT_SPRING_PLAY,
            joints.JOINT_STOP,
            joints.TORQUE_SCALE,
            joints.TORQUE_DELAY,
            joints.TORQUE_LAG,
            joints.TORQUE_SATURATION,
            joints.TORQUE_DEAD_BAND,
            joints.TORQUE_FALLS_WITH_SPEED,
            joints.CLOCK_RATE,
            sensor.ANGLE_LAG,
            sensor.SPEED_LAG,
            sensor.SENSOR_GAIN_OF_MECHANISM,
            sensor.SENSOR_CROSSTALK_OF_MECHANISM,
            sensor.SENSOR_DRIFT_OF_MECHANISM,
            sensor.SENSOR_LAG_OF_MECHANISM,
            sensor.CLOCK_OFFSET_OF_MECHANISM,
            ground.CONTACT_STIFFNESS,
            ground.CONTACT_DAMPING,
            ground.CONTACT_FRICTION,
            ground.CONTACT_POWER,
            rig.GRAVITY_TILT_OF_MECHANISM,
            rig.PRESCRIBED_OFFSET,
            rig.PRESCRIBED_ANGLE_OFFSET,
            rig.FLUID_DRAG_OF_MECHANISM,
            rig.ADDED_MASS,
            rig.CENTRE_OF_MASS,
        )
    )
)
