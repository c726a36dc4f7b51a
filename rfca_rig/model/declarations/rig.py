"""Effects of masses, and of what surrounds a mechanism: the frame, the direction of gravity, the
fluid.
"""

from dataclasses import replace

from rfca_rig.model.effect import Declaration

TIP_MASS = Declaration(
    id="tip_mass",
    where="tip",
    left_out="mass at the tip",
    law="point mass at the distal end of the last link",
    source="-",
    families=("leg_mass",),
    bench_test="weighing",
)

HEAVIER_LINK = Declaration(
    id="heavier_link",
    where="one link",
    left_out="one link heavier than stated",
    law="mass of that link times a factor, spread evenly over it",
    source="uniform rod, moment of inertia m L^2 / 12",
    families=("leg_mass",),
    bench_test="weighing",
)

ADDED_MASS = Declaration(
    id="added_mass",
    where="bodies",
    left_out="a body is heavier",
    law=(
        "its mass grows, and its inertia as much; numbers above that of the last body are the "
        "sites of the model, where it is a point mass"
    ),
    source="-",
    families=("leg_mass", "joint_position_torque", "joint_inertia", "body_mass"),
    bench_test="weighing a body",
)

CENTRE_OF_MASS = Declaration(
    id="centre_of_mass",
    where="bodies",
    left_out="the centre of mass of a body is elsewhere",
    law="its distance from the body's frame is larger by the shift, in the same direction",
    source="-",
    families=("joint_position_torque", "body_mass"),
    bench_test="balancing",
)

FRAME_COMPLIANCE = Declaration(
    id="frame_compliance",
    where="rig",
    left_out="frame and sensor yield",
    law=(
        "m x'' + 2 d m w x' + m w^2 x = fz cos(lean) - fy sin(lean), x along a line that "
        "leans from down towards y"
    ),
    source="one mode of vibration: Ewins, Modal Testing, 2000",
    families=("floor_yields", "rig_yields"),
    bench_test="tap test",
)

GRAVITY_TILT = Declaration(
    id="gravity_tilt",
    where="rig",
    left_out="rig not plumb",
    law=(
        "gravity = g (sin, cos) of the angle, along y and down; fy - s m g sin(angle), s = 0 "
        "unless given"
    ),
    source="-",
    families=("rig_tilt", "joint_position_torque"),
    bench_test="rest pose",
)

GRAVITY_TILT_OF_MECHANISM = replace(
    GRAVITY_TILT, law="gravity turned about the world's x and y axis"
)

FLUID_DRAG = Declaration(
    id="fluid_drag",
    where="surroundings",
    left_out="drag normal to the links",
    law="F = - c length v |v| at the middle of each link",
    source="quadratic drag of a flat strip, c = rho C_D width / 2",
    # Of a mechanism it is a loss like that of its joints.
    families=("air_drag", "joint_dissipation", "joint_loss_with_speed"),
)

FLUID_DRAG_OF_MECHANISM = replace(
    FLUID_DRAG,
    left_out="drag of the bodies that grows with the square of their speed",
    law="F = density / 2 A |v| v on each side A of the box with the body's mass and inertia",
    source="MuJoCo, fluid forces",
)

PRESCRIBED_OFFSET = Declaration(
    id="prescribed_offset",
    where="rig",
    left_out="a prescribed slide stands elsewhere than it reads",
    law="q_read = q + offset, in all recordings alike",
    source="-",
    families=("floor_geometry",),
)

PRESCRIBED_ANGLE_OFFSET = Declaration(
    id="prescribed_angle_offset",
    where="rig",
    left_out="a prescribed hinge stands elsewhere than it reads",
    law="q_read = q + offset, in all recordings alike",
    source="-",
)
