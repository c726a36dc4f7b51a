"""Meanings of the error byte of a CubeMars AK drive, in MIT replies and in servo status frames.

Source: AK Series Module Driver Manual V1.0.18, fault codes over CAN. Earlier manuals give 6 as unbalanced phase currents and have no 7.
The long list of the serial port (over-voltage = 1 ...) is a different one and is never sent over CAN.
"""

ERRORS = {
    1: "motor too hot",
    2: "motor current above its limit",
    3: "supply voltage above its limit",
    4: "supply voltage below its limit; check the power supply",
    5: "encoder fault",
    6: "power stage too hot (older firmware: unbalanced phase currents, the hardware may be damaged)",
    7: "motor stalled",
}


def error_text(code: int) -> str:
    """The code with its meaning; 0 means no error."""
    return f"error {code} ({ERRORS.get(code, 'not documented') if code else 'none'})"
