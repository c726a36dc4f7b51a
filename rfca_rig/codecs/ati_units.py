"""Units of force and torque in ATI's configuration pages, calibration files and command interface.

Names and codes: ATI manual 9620-05-net ft, tables of `cfgfu` and `cfgtu`. The spellings in calibration files are those that ATI's
DAQ F/T C library accepts.
"""

from rfca_rig.codecs.malformed import MalformedFrame

_LBF_N = 0.45359237 * 9.80665
_INCH_M = 0.0254

# The position in these tuples, from 1, is the code.
_FORCE_CODES = ("lbf", "N", "klbf", "kN", "kgf", "gf")
_TORQUE_CODES = ("lbf-in", "lbf-ft", "Nm", "Nmm", "kgf-cm", "kNm")

_NEWTONS = {"lbf": _LBF_N, "N": 1.0, "klbf": 1e3 * _LBF_N, "kN": 1e3, "kgf": 9.80665, "gf": 9.80665e-3}
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


def newtons_per(unit: str) -> float:
    """Newtons in one unit. Raises MalformedFrame for an unknown unit: a guess would scale every force wrongly."""
    return _size(unit, _NEWTONS, "force")


def newton_metres_per(unit: str) -> float:
    """Newton metres in one unit. Raises MalformedFrame for an unknown unit."""
    return _size(unit, _NEWTON_METRES, "torque")


def _size(unit: str, sizes: dict[str, float], of_what: str) -> float:
    name = unit.strip()
    name = _OTHER_NAMES.get(name, name)
    if name not in sizes:
        raise MalformedFrame(f"{unit!r} is no known unit of {of_what}; known are {', '.join(sizes)}")
    return sizes[name]


def force_unit(code: int) -> str:
    """The unit behind a code of `cfgfu` or of the command interface. Raises MalformedFrame for any other number."""
    return _unit_of(code, _FORCE_CODES, "force")


def torque_unit(code: int) -> str:
    """The unit behind a code of `cfgtu` or of the command interface. Raises MalformedFrame for any other number."""
    return _unit_of(code, _TORQUE_CODES, "torque")


def force_code(unit: str) -> int:
    """The inverse of `force_unit`."""
    return _FORCE_CODES.index(unit) + 1


def torque_code(unit: str) -> int:
    """The inverse of `torque_unit`."""
    return _TORQUE_CODES.index(unit) + 1


def _unit_of(code: int, names: tuple[str, ...], of_what: str) -> str:
    if not 1 <= code <= len(names):
        raise MalformedFrame(f"{code} is no known code of a unit of {of_what}, expected 1..{len(names)}")
    return names[code - 1]
