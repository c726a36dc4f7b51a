"""Names and units of the recorded channels. Each name ends with its unit; axes and signs are those of the sensor (z down)."""

SHAFT = ("shaft_angle_rad", "shaft_speed_rad_s", "motor_torque_Nm")
WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
# Joint 1 is the motor shaft and has no hinge, so hinges are numbered from 2.
HINGES = tuple(f"hinge{i}_deg" for i in range(2, 8))

UNITS = {
    "t_s": "s",
    "host_s": "s",
    "shaft_angle_rad": "rad",
    "shaft_speed_rad_s": "rad/s",
    "motor_torque_Nm": "N m",
    **{name: name.split("_")[1].replace("Nm", "N m") for name in WRENCH},
    **dict.fromkeys(HINGES, "deg"),
}
