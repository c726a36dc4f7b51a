"""Effects in the joints of a mechanism, in their gears, and on the commands of their actuators."""

from rfca_rig.model.effect import Declaration

JOINT_STRIBECK = Declaration(
    id="joint_stribeck",
    where="joints",
    left_out="dry friction of the joints that falls with speed",
    law="T = T_c (1 + rise exp(-|w| / w_s)) sgn(w), w_s a share of the usual speed",
    source="Stribeck 1902, exponential form",
    families=("joint_dissipation", "joint_dry_loss"),
    law_of="speed",
)

JOINT_FRICTION = Declaration(
    id="joint_friction",
    where="joints",
    left_out="dry friction of the joints and their gears",
    law="T = T_c sgn(w)",
    source="MuJoCo, XML reference",
    families=("joint_dissipation", "joint_dry_loss"),
    single="joint",
    variant_of=JOINT_STRIBECK.id,
    law_of="speed",
)

# Dry friction is a limit of this law and of Stribeck's, so none of them counts as evidence against
# another.
JOINT_HYSTERESIS = Declaration(
    id="joint_hysteresis",
    where="joints",
    left_out="hysteresis of the joints: friction that builds up over an angle",
    law="T = T_h z, z' = (w / b) (1 - z sgn(w)), b a share of the usual travel",
    source="Dahl 1968",
    families=("joint_dissipation", "joint_dry_loss", "joint_stiffness"),
    variant_of=JOINT_STRIBECK.id,
    law_of="speed",
)

JOINT_LOAD_FRICTION = Declaration(
    id="joint_load_friction",
    where="joints",
    left_out="friction of the gears that grows with the torque they transmit",
    law="T = loss |tau| sgn(w)",
    source="Hamon, Gautier and Garrec, IROS 2010",
    families=("joint_dissipation", "joint_dry_loss"),
    single="joint",
    law_of="speed",
)

JOINT_DAMPING = Declaration(
    id="joint_damping",
    where="joints",
    left_out="damping of the joints",
    law="T = c w",
    source="MuJoCo, XML reference",
    families=("joint_dissipation", "joint_loss_with_speed"),
    single="joint",
    law_of="speed",
)

JOINT_DRAG = Declaration(
    id="joint_drag",
    where="joints",
    left_out="drag that grows with the speed squared",
    law="T = c w |w|",
    source="MuJoCo, XML reference",
    families=("joint_dissipation", "joint_loss_with_speed"),
    single="joint",
    law_of="speed",
)

JOINT_INERTIA = Declaration(
    id="joint_inertia",
    where="joints",
    left_out="inertia of the motors' rotors behind their gears",
    law="T = I a",
    source="MuJoCo, XML reference",
    families=("joint_inertia",),
    single="joint",
)

JOINT_SPRING = Declaration(
    id="joint_spring",
    where="joints",
    left_out="a spring in the joints",
    law="T = k (q - q_0), q_0 of the model file",
    source="MuJoCo, XML reference",
    families=("joint_position_torque", "joint_stiffness"),
    single="joint",
    law_of="position",
)

JOINT_SPRING_PLAY = Declaration(
    id="joint_spring_play",
    where="joints",
    left_out="play before the springs of the joints engage",
    law="the spring's torque at q - q_0 less half the gap, 0 within the gap",
    source="dead zone",
    single="joint",
)

JOINT_STOP = Declaration(
    id="joint_stop",
    where="joints",
    left_out="a stop within the travel of a joint",
    law=(
        "MuJoCo's limit at a share of half the travel from its middle, above it "
        "where the share is positive"
    ),
    source="MuJoCo, XML reference",
    families=("joint_stiffness",),
)

GEAR_COMPLIANCE = Declaration(
    id="gear_compliance",
    where="joints",
    left_out="elastic gears, with encoders on the motors' side",
    law="q_read = q + c tau, tau transmitted by the gear",
    source="Spong 1987, quasi-static",
    families=("gear_yields",),
    single="joint",
    bench_test="blocked joint",
)

GEAR_BACKLASH = Declaration(
    id="gear_backlash",
    where="joints",
    left_out="play of the gears, with encoders on the motors' side",
    law="q_read = q + z, I z'' = tau within the play, |z| <= b / 2, I of the rotor",
    source="Nordin and Gutman 2002",
    families=("gear_yields",),
    single="joint",
    bench_test="blocked joint",
)

TORQUE_SCALE = Declaration(
    id="torque_scale",
    where="joints",
    left_out="scale of the recorded commands wrong",
    law="tau = factor tau_recorded",
    source="torque constant of the motors",
    families=("torque_scale",),
    single="actuator",
    bench_test="weight on a lever",
)

TORQUE_DELAY = Declaration(
    id="torque_delay",
    where="commands",
    left_out="commands act later than recorded (a negative delay: they were recorded late)",
    law="u(t) = u_recorded(t - delay)",
    source="dead time of drive, bus or current sensor",
    families=("torque_scale",),
    bench_test="blocked step",
)

TORQUE_LAG = Declaration(
    id="torque_lag",
    where="commands",
    left_out="the actuators follow their commands with a lag",
    law="T u' = u_recorded - u",
    source="first-order current loop",
    families=("torque_scale",),
    bench_test="blocked step",
)

TORQUE_SATURATION = Declaration(
    id="torque_saturation",
    where="commands",
    left_out="the actuators saturate",
    law="|u| <= limit, a share of the largest recorded command",
    source="limit of current or voltage",
    families=("torque_scale",),
)

TORQUE_DEAD_BAND = Declaration(
    id="torque_dead_band",
    where="commands",
    left_out="the actuators ignore small commands",
    law=("u = sgn(u_r) max(|u_r| - band, 0), the band a share of the largest recorded command u_r"),
    source="dead band of a drive",
    families=("torque_scale",),
)

TORQUE_FALLS_WITH_SPEED = Declaration(
    id="torque_falls_with_speed",
    where="commands",
    left_out="the largest torque of the motors falls with speed",
    law=(
        "|u| <= u_m (1 - fall |w| / w_u) where u drives, u_m the largest "
        "recorded command, w_u the usual speed"
    ),
    source=(
        "torque-speed line of a DC motor at its supply voltage: Hughes and "
        "Drury, Electric Motors and Drives, ch. 3"
    ),
    families=("torque_scale",),
)

CLOCK_RATE = Declaration(
    id="clock_rate",
    where="commands",
    left_out="the clocks of commands and readings run at different rates",
    law="u(t) = u_recorded(t - rate t)",
    source="two clocks",
    families=("torque_scale",),
)
