"""moteus drives of mjbots on CAN-FD; the watchdog time comes with every command."""

from rfca_rig.devices import MotorMake

DEVICE = MotorMake(
    section=f"{__name__}.section:MoteusSection",
    driver=f"{__name__}.driver:make_driver",
    twin=f"{__name__}.twin:make_twin",
    new_twin=f"{__name__}.twin:make_new_twin",
    faults=f"{__name__}.twin:FAULTS",
    check=f"{__name__}.checks:check_drive",
    setup=f"{__name__}.setup:MoteusSetup",
    watchdog_key="watchdog_ms",
    usual={"zero_turns": 0.0},
    example={"drive_id": 1, "gear_ratio": 3.0, "direction": -1, "zero_turns": 2.75},
)
