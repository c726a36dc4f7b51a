"""What force sensors of several makes share: the status word that every driver gives, and the
units that ATI names; pure.
"""

import numpy as np
from numpy.typing import NDArray

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

# The bits of an Ethernet Axia, manual 9610-05-Ethernet Axia, section 5.5. Bits 2, 27 and 30 stay
# for 32 samples after their cause.
AXIA_STATUS_BITS = {
    31: "error, see the other bits",
    30: "force or torque out of range",
    29: "calibration checksum",
    28: "simulated error",
    27: "gage out of range",
    16: "monitor condition latched",
    7: "calibration not accessible",
    5: "other error",
    3: "busy",
    2: "broken gage",
    1: "supply voltage",
    0: "temperature",
}
# No box uses this bit: words of an Axia have it set here, so that a recorded word says whose it is.
OF_AXIA = 1 << 15
# With these its values are no forces. Bit 17, which an Axia does not use, then marks them as it
# does for every make.
_AXIA_OUT_OF_RANGE = 1 << 30 | 1 << 27 | 1 << 2
_COMMON_BITS = OF_AXIA | 1 << 17

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


def mark_axia_status(words: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Status words (m,) of an Ethernet Axia, with bit 15 as its mark, and bits 31 and 17 where its
    values are no forces. Healthy words and warnings stay as they are.
    """
    if not np.count_nonzero(words):
        return words
    marked = words | np.uint32(OF_AXIA)
    out_of_range = words & np.uint32(_AXIA_OUT_OF_RANGE) != 0
    marked[out_of_range] |= np.uint32(SATURATED)
    marked[np.isin(words, list(WARNINGS))] &= np.uint32(~OF_AXIA & 0xFFFFFFFF)
    return marked


def status_text(word: int) -> str:
    """The status word in hexadecimal with the meaning of every bit that is set, except the
    summary bit. A word that `mark_axia_status` marked is shown as the Axia sent it.
    """
    table = STATUS_BITS
    if word & OF_AXIA:
        table = AXIA_STATUS_BITS
        word &= ~_COMMON_BITS
    bits = [bit for bit in range(30, -1, -1) if word >> bit & 1]
    meanings = [table.get(bit, f"bit {bit}, not documented") for bit in bits]
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
