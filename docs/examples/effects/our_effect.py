"""A damper in every hinge whose torque grows with the cube of the speed."""

from rfca_rig.model.effect import Effect, JointTorque, Parameter
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.setup import with_law


def torque(phi, rate, elapsed, k0, k2, memory, parameter):
    return parameter[0] * rate**3, 0.0, 3.0 * parameter[0] * rate**2


def apply(setup, values):
    return with_law(setup, LawUse(HINGE, torque, (values["coefficient_Nm_s3_per_rad3"],)))


def torque_of_joint(speed, values):
    return values["coefficient_Nm_s3_per_rad3"] * speed**3


EFFECT = Effect(
    id="cubic_damping",
    where="hinges",
    left_out="damping that grows with speed",
    law="T = c phi'^3",
    source="our own drop tests",
    parameters=(Parameter("coefficient_Nm_s3_per_rad3", 1e-4, 1e-1),),
    apply=apply,
    joint_torque=JointTorque("speed", torque_of_joint),
)
