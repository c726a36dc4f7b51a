"""Facts on CubeMars / T-Motor AK drives: ranges of the fields of the MIT mode of each model,
meanings of the error byte, CAN databases.

The frame carries fractions of a range that is not transmitted: with another drive's range every
value is scaled wrongly, without an error. So a row is chosen by model, and by model and firmware
where a firmware differs from the manual.

The manufacturer provides no CAN databases (DBC) for bus monitors. The files in `dbc/` are the texts
made here. A DBC holds one message per arbitration id. The one for MIT mode therefore has the
replies under id 0, where drives with a master id of 0 send them. For a drive that replies under its
own id, set `reply_id` to None; the database then has no command.

Sources: for names without a version, CubeMars AK Series Module Driver Manual V1.0.18, MIT mode,
table of parameter ranges. For names with a version, the table of DFKI's
mini-cheetah-tmotor-python-can (src/motor_driver/canmotorlib.py), measured on drives of that
firmware.

Source: AK Series Module Driver Manual V1.0.18, fault codes over CAN. Earlier manuals give 6 as
unbalanced phase currents and have no 7. The long list of the serial port (over-voltage = 1 ...) is
a different one and is never sent over CAN.
"""

from dataclasses import dataclass

from rfca_rig.devices.cubemars.codec.servo import OriginMode, Packet
from rfca_rig.errors import BadInput

ERRORS = {
    1: "motor too hot",
    2: "motor current above its limit",
    3: "supply voltage above its limit",
    4: "supply voltage below its limit; check the power supply",
    5: "encoder fault",
    6: (
        "power stage too hot (older firmware: unbalanced phase currents, the hardware may be "
        "damaged)"
    ),
    7: "motor stalled",
}

# Ranges of kp and kd, both from 0 and the same on every drive.
GAIN_Nm_PER_RAD = 500.0
GAIN_Nm_S_PER_RAD = 5.0


def error_text(code: int) -> str:
    """The code with its meaning; 0 means no error."""
    meaning = "none"
    if code:
        meaning = ERRORS.get(code, "not documented")
    return f"error {code} ({meaning})"


@dataclass(frozen=True)
class MitRanges:
    """Ranges at the output shaft, each from minus to plus its value. Temperatures are sent with
    `temperature_offset_degC` added.
    """

    model: str
    speed_rad_s: float
    torque_Nm: float
    position_rad: float = 12.5
    temperature_offset_degC: int = 40

    @property
    def gear_ratio(self) -> float:
        """Turns of the motor per turn of the output, as the model is named: 9 of an AK80-9-V2.0."""
        return float(self.model.split("-")[1])


MIT_RANGES = {
    row.model: row
    for row in (
        MitRanges("AK10-9", 50.0, 65.0),
        MitRanges("AK40-10", 45.5, 5.0),
        MitRanges("AK45-10", 20.0, 8.0),
        MitRanges("AK45-36", 6.0, 34.0),
        MitRanges("AK60-6", 45.0, 15.0),
        MitRanges("AK70-10", 50.0, 25.0),
        MitRanges("AK80-6", 76.0, 12.0),
        MitRanges("AK80-8", 37.5, 32.0),
        MitRanges("AK80-9", 50.0, 18.0),
        MitRanges("AK80-64", 8.0, 144.0),
        MitRanges("AK70-10-V1.1", 50.0, 24.0, temperature_offset_degC=0),
        MitRanges("AK80-6-V1.0", 45.0, 18.0, position_rad=95.5, temperature_offset_degC=0),
        MitRanges("AK80-6-V1.1", 22.5, 12.0, temperature_offset_degC=0),
        MitRanges("AK80-9-V1.1", 22.5, 18.0, temperature_offset_degC=0),
        MitRanges("AK80-9-V2.0", 25.64, 18.0, temperature_offset_degC=0),
    )
}


def mit_ranges(model: str) -> MitRanges:
    """The ranges of a model. Raises BadInput, with the known models, for one that is not in the
    table.
    """
    if model not in MIT_RANGES:
        raise BadInput(f"drive: model {model!r} is not known, known are {', '.join(MIT_RANGES)}")
    return MIT_RANGES[model]


# A DBC marks extended identifiers by this bit.
EXTENDED = 1 << 31
_HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: host drive\n'


def mit_dbc(ranges: MitRanges, drive_id: int = 1, reply_id: int | None = 0) -> str:
    """The database of one drive in MIT mode: command and reply. With `reply_id` None it has the
    reply only, under the drive's own id.
    """
    command = _message(
        drive_id,
        "MIT_Command",
        8,
        "host",
        _range_signal("Position", 7, 16, -ranges.position_rad, ranges.position_rad, "rad"),
        _range_signal("Speed", 23, 12, -ranges.speed_rad_s, ranges.speed_rad_s, "rad/s"),
        _range_signal("Kp", 27, 12, 0.0, GAIN_Nm_PER_RAD, "Nm/rad"),
        _range_signal("Kd", 47, 12, 0.0, GAIN_Nm_S_PER_RAD, "Nm.s/rad"),
        _range_signal("Torque", 51, 12, -ranges.torque_Nm, ranges.torque_Nm, "Nm"),
    )
    answer_id = reply_id
    if answer_id is None:
        answer_id = drive_id
    reply = _message(
        answer_id,
        "MIT_Reply",
        8,
        "drive",
        _signal("Drive_Id", 7, 8, "+", 1.0, 0.0, ""),
        _range_signal("Position", 15, 16, -ranges.position_rad, ranges.position_rad, "rad"),
        _range_signal("Speed", 31, 12, -ranges.speed_rad_s, ranges.speed_rad_s, "rad/s"),
        _range_signal("Torque", 35, 12, -ranges.torque_Nm, ranges.torque_Nm, "Nm"),
        _signal("Temperature", 55, 8, "+", 1.0, -float(ranges.temperature_offset_degC), "degC"),
        _signal("Error", 63, 8, "+", 1.0, 0.0, ""),
    )
    messages = [command, reply]
    if reply_id is None:
        messages = [reply]
    return _HEAD + "".join(messages) + _values(answer_id, "Error", {0: "none", **ERRORS})


def servo_dbc(drive_id: int = 1) -> str:
    """The database of one drive in servo mode: all commands and the status frame."""
    position = _signal("Position", 7, 32, "-", 1e-4, 0.0, "deg")
    commands = {
        Packet.DUTY: (4, [_signal("Duty", 7, 32, "-", 1e-5, 0.0, "")]),
        Packet.CURRENT: (4, [_signal("Current", 7, 32, "-", 1e-3, 0.0, "A")]),
        Packet.CURRENT_BRAKE: (4, [_signal("Current", 7, 32, "-", 1e-3, 0.0, "A")]),
        Packet.SPEED: (4, [_signal("Speed", 7, 32, "-", 1.0, 0.0, "ERPM")]),
        Packet.POSITION: (4, [position]),
        Packet.ORIGIN: (1, [_signal("Origin", 7, 8, "+", 1.0, 0.0, "")]),
        Packet.POSITION_SPEED: (
            8,
            [
                position,
                _signal("Speed", 39, 16, "-", 10.0, 0.0, "ERPM"),
                _signal("Acceleration", 55, 16, "-", 10.0, 0.0, "ERPM/s"),
            ],
        ),
    }
    status = [
        _signal("Position", 7, 16, "-", 0.1, 0.0, "deg"),
        _signal("Speed", 23, 16, "-", 10.0, 0.0, "ERPM"),
        _signal("Current", 39, 16, "-", 0.01, 0.0, "A"),
        _signal("Temperature", 55, 8, "-", 1.0, 0.0, "degC"),
        _signal("Error", 63, 8, "+", 1.0, 0.0, ""),
    ]
    messages = [
        _message(_servo_id(p, drive_id), f"Set_{p.name}", size, "host", *s)
        for p, (size, s) in commands.items()
    ]
    messages.append(_message(_servo_id(Packet.STATUS, drive_id), "Status", 8, "drive", *status))
    meanings = _values(
        _servo_id(Packet.ORIGIN, drive_id),
        "Origin",
        {origin.value: origin.name.lower() for origin in OriginMode},
    )
    return (
        _HEAD
        + "".join(messages)
        + meanings
        + _values(_servo_id(Packet.STATUS, drive_id), "Error", {0: "none", **ERRORS})
    )


def _servo_id(packet: Packet, drive_id: int) -> int:
    return EXTENDED | packet << 8 | drive_id


def _message(can_id: int, name: str, size: int, sender: str, *signals: str) -> str:
    receiver = "drive" if sender == "host" else "host"
    return f"\nBO_ {can_id} {name}: {size} {sender}\n" + "".join(
        f" {signal} {receiver}\n" for signal in signals
    )


def _range_signal(name: str, start: int, bits: int, low: float, high: float, unit: str) -> str:
    return _signal(
        name, start, bits, "+", (high - low) / ((1 << bits) - 1), low, unit, f"[{low:g}|{high:g}]"
    )


def _signal(
    name: str,
    start: int,
    bits: int,
    sign: str,
    factor: float,
    offset: float,
    unit: str,
    limits: str = "[0|0]",
) -> str:
    """One signal line; `start` is the position of the highest bit, in Motorola order."""
    return f'SG_ {name} : {start}|{bits}@0{sign} ({factor!r},{offset!r}) {limits} "{unit}"'


def _values(can_id: int, signal: str, meanings: dict[int, str]) -> str:
    return (
        f"\nVAL_ {can_id} {signal} "
        + " ".join(f'{code} "{text}"' for code, text in meanings.items())
        + " ;\n"
    )
