"""What force sensors of several makes share: the status word that every driver gives, and the
units that ATI names; pure.
"""

from rfca_rig.errors import MalformedFrame

# The bits of the Net F/T, manual 9620-05-net ft. Drivers of other sensors set the same ones.
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

_LBF_N = 0.45359237 * 9.80665
_INCH_M = 0.0254

# The position in these tuples, from 1, is the code.
_FORCE_CODES = ("lbf", "N", "klbf", "kN", "kgf", "gf")
_TORQUE_CODES = ("lbf-in", "lbf-ft", "Nm", "Nmm", "kgf-cm", "kNm")

_NEWTONS = {
    "lbf": _LBF_N,
    "N": 1.0,
    "klbf": 1e3 * _LBF_N,
    "kN": 1e3,
    "kgf": 9.80665,
    "gf": 9.80665e-3,
}
_NEWTON_METRES = {
    "lbf-in": _LBF_N * _INCH_M,
    "lbf-ft": 12.0 * _LBF_N * _INCH_M,
    "Nm": 1.0,
    "Nmm": 1e-3,
    "kgf-cm": 9.80665e-2,
    "kNm": 1e3,
}

_OTHER_NAMES = {
    "lb": "lbf",
    "klb": "klbf",
    "kg": "kgf",
    "g": "gf",
    **dict.fromkeys(("in-lb", "in-lbf", "lb-in"), "lbf-in"),
    **dict.fromkeys(("ft-lb", "ft-lbf", "lb-ft"), "lbf-ft"),
    "N-m": "Nm",
    "N-mm": "Nmm",
    **dict.fromkeys(("kg-cm", "kgcm"), "kgf-cm"),
    "kN-m": "kNm",
}


def status_text(word: int) -> str:
    """The status word in hexadecimal with the meaning of every bit that is set, except the
    summary bit.
    """
    bits = [bit for bit in range(30, -1, -1) if word >> bit & 1]
    meanings = [STATUS_BITS.get(bit, f"bit {bit}, not documented") for bit in bits]
    if not word:
        meanings = ["healthy"]
    elif not meanings:
        meanings = [STATUS_BITS[31]]
    return f"status 0x{word:08x} ({'; '.join(meanings)})"


def newtons_per(unit: str) -> float:
    """Newtons in one unit. Raises MalformedFrame for an unknown unit: a guess would scale every
    force wrongly.
    """
    return _size(unit, _NEWTONS, "force")


def newton_metres_per(unit: str) -> float:
    """Newton metres in one unit. Raises MalformedFrame for an unknown unit."""
    return _size(unit, _NEWTON_METRES, "torque")


def _size(unit: str, sizes: dict[str, float], of_what: str) -> float:
    name = unit.strip()
    name = _OTHER_NAMES.get(name, name)
    if name not in sizes:
        raise MalformedFrame(
            f"{unit!r} is no known unit of {of_what}; known are {', '.join(sizes)}"
        )
    return sizes[name]


def force_unit(code: int) -> str:
    """The unit behind a code of `cfgfu` or of the command interface. Raises MalformedFrame for
    any other number.
    """
    return _unit_of(code, _FORCE_CODES, "force")


def torque_unit(code: int) -> str:
    """The unit behind a code of `cfgtu` or of the command interface. Raises MalformedFrame for
    any other number.
    """
    return _unit_of(code, _TORQUE_CODES, "torque")


def force_code(unit: str) -> int:
    """The inverse of `force_unit`."""
    return _FORCE_CODES.index(unit) + 1


def torque_code(unit: str) -> int:
    """The inverse of `torque_unit`."""
    return _TORQUE_CODES.index(unit) + 1


def _unit_of(code: int, names: tuple[str, ...], of_what: str) -> str:
    if not 1 <= code <= len(names):
        raise MalformedFrame(
            f"{code} is no known code of a unit of {of_what}, expected 1..{len(names)}"
        )
    return names[code - 1]
