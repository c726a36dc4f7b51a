"""ATI F/T Controllers (CTL, CON) on a serial port."""

from rfca_rig.devices import SensorMake

DEVICE = SensorMake(
    section=f"{__name__}.section:AtiSerialSection",
    driver=f"{__name__}.driver:make_driver",
    twin=f"{__name__}.twin:make_twin",
    wire=f"{__name__}.twin:WIRE",
    check=f"{__name__}.checks:check_sensor",
    usual={"counts_per_N": 20.0, "counts_per_Nm": 333.3333, "rate_Hz": 60.0},
    example={"counts_per_N": 20.0, "counts_per_Nm": 333.3333, "rate_Hz": 80.0},
)
