"""Writes logs of a CAN bus by python-can's own writers, of frames that cantools encodes."""

import can
import cantools.database
import numpy as np

BEGIN_S = 1_714_500_000.0
ENDINGS = (".blf", ".asc", ".log", ".trc")

# Floats, scaled integers of both byte orders, one of 29 bits, signals that share bytes, CAN FD.
DBC = """VERSION ""
BU_: Motor
BO_ 41 Encoder: 8 Motor
 SG_ Position : 0|32@1- (1,0) [0|0] "rad" Motor
 SG_ Velocity : 32|32@1- (1,0) [0|0] "rad/s" Motor
BO_ 2147484160 Torque: 6 Motor
 SG_ Little : 0|16@1- (0.001,-2) [0|0] "Nm" Motor
 SG_ Big : 23|24@0- (0.0001,0.5) [0|0] "Nm" Motor
BO_ 512 Status: 8 Motor
 SG_ Page M : 0|8@1+ (1,0) [0|0] "" Motor
 SG_ Temperature m0 : 8|16@1- (0.1,0) [0|0] "degC" Motor
 SG_ Current m1 : 8|16@1- (0.01,0) [0|0] "A" Motor
BO_ 1025 Wide: 64 Motor
 SG_ Last : 480|32@1- (1,0) [0|0] "" Motor
SIG_VALTYPE_ 41 Position : 1;
SIG_VALTYPE_ 41 Velocity : 1;
SIG_VALTYPE_ 1025 Last : 1;
VAL_ 512 Current 32767 "SNA" ;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 1025 2;
"""
DATABASE = cantools.database.load_string(DBC, "dbc")


def write_database(folder, text=DBC, name="motor.dbc"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def frame(t_s, message, values, **changes):
    """A frame of a message of the database, `t_s` after the beginning of the recording."""
    definition = DATABASE.get_message_by_name(message)
    return raw_frame(
        t_s,
        definition.frame_id,
        definition.encode(values, strict=False),
        **{
            "is_extended_id": definition.is_extended_frame,
            "is_fd": definition.is_fd,
            **changes,
        },
    )


def raw_frame(t_s, identifier, data, **changes):
    stated = {"is_extended_id": False, "channel": 0, "is_rx": True, **changes}
    return can.Message(timestamp=t_s, arbitration_id=identifier, data=data, **stated)


def write_log(path, frames, begin_s=BEGIN_S):
    """A log of these frames, in the order of their times."""
    with can.Logger(path) as log:
        for message in sorted(frames, key=lambda message: message.timestamp):
            message.timestamp += begin_s
            log.on_message_received(message)
    return path


def encoder_frames(t_s, **changes):
    """Frames of a joint that turns with sin t."""
    return [
        frame(t, "Encoder", {"Position": np.sin(t), "Velocity": np.cos(t)}, **changes) for t in t_s
    ]


def torque_frames(t_s):
    return [frame(t, "Torque", {"Little": 3.0 * np.cos(t), "Big": -7.0 * np.cos(t)}) for t in t_s]
