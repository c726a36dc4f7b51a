"""The status word of an ATI Net F/T NetBox. Source: the table in netft-cpp, src/status.cpp; Axia sensors have another one."""

STATUS_BITS = {
    31: "error, see the other bits",
    30: "CPU or RAM",
    29: "digital board",
    28: "analog board",
    27: "serial link",
    26: "program memory",
    25: "halted by its configuration",
    24: "settings",
    23: "configuration does not match the calibration",
    22: "network",
    21: "CAN",
    20: "RDT",
    19: "EtherNet/IP",
    18: "DeviceNet",
    17: "transducer saturation or A/D error",
    16: "monitor condition latched",
    14: "watchdog",
    13: "stack",
    12: "I2C EEPROM",
    11: "SPI flash",
    10: "analog watchdog",
    9: "excitation too high",
    8: "excitation too low",
    7: "artificial ground",
    6: "supply too high",
    5: "supply too low",
    4: "serial link data unavailable",
    3: "reference voltage",
    2: "temperature",
    1: "HTTP",
}

# Summary bit; the other bits give the reason.
ERROR = 1 << 31
SATURATED = ERROR | 1 << 17
MONITOR_LATCHED = 1 << 16
# Words with which the values are good: a latched monitor condition does not affect them.
WARNINGS = frozenset({0, MONITOR_LATCHED, ERROR | MONITOR_LATCHED})


def status_text(word: int) -> str:
    """The status word in hexadecimal with the meaning of every bit that is set, except the summary bit."""
    bits = [bit for bit in range(30, -1, -1) if word >> bit & 1]
    meanings = [STATUS_BITS.get(bit, f"bit {bit}, not documented") for bit in bits] or [STATUS_BITS[31] if word else "healthy"]
    return f"status 0x{word:08x} ({'; '.join(meanings)})"
