"""The ATI Net F/T, a box on the network. The shipped twin has one, with the usual values of its
keys.
"""

from rfca_rig.devices import SensorMake

DEVICE = SensorMake(
    section=f"{__name__}.section:NetFtSection",
    open=f"{__name__}.driver:open_connection",
    driver=f"{__name__}.driver:make_driver",
    twin=f"{__name__}.twin:make_twin",
    wire=f"{__name__}.ports:WIRE",
    check=f"{__name__}.checks:check_sensor",
    check_way=f"{__name__}.checks:check_way",
    find=f"{__name__}.checks:find_sensor",
    address=("host", "its address", "192.168.1.1"),
    example={"counts_per_N": 1e6, "counts_per_Nm": 1e6, "rate_Hz": 7000.0},
)
