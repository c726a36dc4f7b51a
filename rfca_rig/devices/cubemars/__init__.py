"""CubeMars / T-Motor AK drives on CAN, in MIT and in servo mode. They have no watchdog, so a
guardian takes the torque away.
"""

from rfca_rig.devices import MotorMake

MIT = MotorMake(
    section=f"{__name__}.section:CubemarsMitSection",
    driver=f"{__name__}.driver.mit:make_driver",
    twin=f"{__name__}.twin:make_mit_twin",
    new_twin=f"{__name__}.twin:make_new_mit_twin",
    setup=f"{__name__}.setup:make_mit_setup",
    faults=f"{__name__}.twin:FAULTS",
    check=f"{__name__}.checks:check_mit_drive",
    torque_off=f"{__name__}.driver.mit:make_torque_off",
    usual={"model": "AK80-9", "zero_deg": 0.0},
    example={"drive_id": 1, "model": "AK80-9", "direction": -1, "zero_rad": 2.25},
)
_MOTOR = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.115}
SERVO = MotorMake(
    section=f"{__name__}.section:CubemarsServoSection",
    driver=f"{__name__}.driver.servo:make_driver",
    twin=f"{__name__}.twin:make_servo_twin",
    new_twin=f"{__name__}.twin:make_new_servo_twin",
    setup=f"{__name__}.setup:make_servo_setup",
    faults=f"{__name__}.twin:FAULTS",
    check=f"{__name__}.checks:check_servo_drive",
    torque_off=f"{__name__}.driver.servo:make_torque_off",
    usual={**_MOTOR, "zero_deg": 0.0, "status_period_ms": 2.0},
    example={"drive_id": 1, **_MOTOR, "direction": -1, "zero_deg": 130.0, "status_period_ms": 2.0},
)
