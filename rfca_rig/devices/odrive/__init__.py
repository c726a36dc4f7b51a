"""ODrives with CANSimple, firmware 0.6 or 0.5. The shipped twin has one, with the usual values
of its keys.
"""

from rfca_rig.devices import MotorMake

DEVICE = MotorMake(
    section=f"{__name__}.section:OdriveSection",
    driver=f"{__name__}.driver:make_driver",
    twin=f"{__name__}.twin:make_twin",
    new_twin=f"{__name__}.twin:make_new_twin",
    setup=f"{__name__}.setup:make_setup",
    faults=f"{__name__}.twin:FAULTS",
    check=f"{__name__}.checks:check_drive",
    number=("node_id", 0),
    example={
        "node_id": 0,
        "gear_ratio": 9.0,
        "direction": -1,
        "zero_turns": 2.75,
        "encoder_period_ms": 1.0,
    },
)
