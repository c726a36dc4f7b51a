"""ATI DAQ F/T transducers, whose gage voltages a sampling card reads."""

from rfca_rig.devices import SensorMake

DEVICE = SensorMake(
    section=f"{__name__}.section:AtiDaqSection",
    open=f"{__name__}.driver:open_card",
    driver=f"{__name__}.driver:make_driver",
    twin=f"{__name__}.twin:make_twin",
    # The card is read by calls: its twin is what the driver reads.
    wire=None,
    check=f"{__name__}.checks:check_sensor",
    address=(
        "calibration_file",
        "its calibration file, .cal, in the folder of the rig file",
        "transducer.cal",
    ),
    usual={"rate_Hz": 15000.0},
    example={"calibration_file": "made-up-gamma.cal", "rate_Hz": 15000.0},
)
