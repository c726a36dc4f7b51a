"""What a file is by its first bytes, and the way out for one that cannot be read.

The ending of a name says what somebody meant; the first bytes say what is there.
"""

import gzip
import re
from collections.abc import Mapping
from pathlib import Path

import h5py

from rfca_rig.errors import BadInput

GZIP = b"\x1f\x8b"
MATLAB_5 = b"MATLAB 5.0 MAT-file"
# As far as any of these signs lies from the beginning: that of a tar archive.
LOOKED_AT = 512

# Kinds of CAN logs, in words.
BLF = "BLF"
ASC = "Vector ASC"
CANDUMP = "candump"
TRC = "PEAK TRC"
# Endings of databases that define the messages of a CAN bus.
CAN_DATABASES = (".dbc", ".kcd", ".sym", ".arxml")
TRC_VERSION = ";$FILEVERSION="

ROS_1_BAG = b"#ROSBAG V"
# At both ends of a whole MCAP file (mcap.dev, file format).
MCAP = b"\x89MCAP0\r\n"
ZSTD = b"\x28\xb5\x2f\xfd"
# The first bytes of a kind of file, what it is, and how to make a readable one of it.
FOREIGN: Mapping[bytes, tuple[str, str]] = {
    ZSTD: ("compressed by zstd", "unpack it: zstd -d; of a ROS 2 bag give the folder"),
    b"BZh": ("compressed by bzip2", "unpack it: bunzip2"),
    b"\xfd7zXZ\x00": ("compressed by xz", "unpack it: unxz"),
    b"7z\xbc\xaf\x27\x1c": ("a 7-Zip archive", "unpack it"),
    b"\x93NUMPY": ("a NumPy array", "save it as CSV with a line of names: numpy.savetxt"),
    b"SQLite format 3": ("an SQLite database", "give the folder of the bag, or a table of it"),
    b"\xd0\xcf\x11\xe0": ("an old Excel file", "save it as CSV"),
    b"\x89PNG": ("a picture", "give a recording"),
    b"%PDF": ("a PDF", "give a recording"),
}
# An archive of the kind zip is many things.
_ZIP = b"PK\x03\x04"
_OF_ZIP = {
    ".xlsx": ("an Excel file", "save it as CSV"),
    ".ods": ("a spreadsheet", "save it as CSV"),
    ".npz": ("NumPy arrays", "save them as CSV with a line of names: numpy.savetxt"),
}
# In place of a table, where only a table can be read.
NO_TABLE = "a table of text is needed here; an experiment.toml may name it"

_BLF_SIGN = b"LOGG"
# Lines with which logs of a CAN bus begin. No name of a column looks so.
_CAN_TEXT: Mapping[str, re.Pattern[str]] = {
    # "date Wed May 01 12:00:00 2024", "base hex  timestamps absolute"
    ASC: re.compile(
        r"(?://.*\n|\s)*(?:date\s+\S+\s+\S+\s+\d+\s+\d+:\d+|base\s+(?:hex|dec)\b)", re.I
    ),
    # "(1714500000.000000) can0 029#BC46 R"
    CANDUMP: re.compile(r"\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}#"),
    TRC: re.compile(r";\$FILEVERSION=|;#{20}"),
}
# "  can0  029   [8]  BC 46 73 B9", also with a time in front, and with a direction.
_CANDUMP_ON_SCREEN = re.compile(
    r"\s*(?:\([\d. :-]+\)\s+)?\S+\s+(?:[RT]X\s\S+\s+\S+\s+)?[0-9A-F]{3,8}\s+\[\d+\]\s"
)


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, whatever its name says; MATLAB's v7.3 is. Raises BadInput where it
    cannot be read.
    """
    if not path.is_file():
        return False
    # Its message names the cause, that of HDF5 the bytes.
    read_beginning(path)
    return bool(h5py.is_hdf5(path))


def is_matlab_5(path: Path) -> bool:
    """Whether a file is one that MATLAB saves without -v7.3."""
    return path.is_file() and read_beginning(path).startswith(MATLAB_5)


def read_beginning(path: Path) -> bytes:
    """The first bytes of a file. Raises BadInput where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(LOOKED_AT)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from None


def refuse_foreign(path: Path, beginning: bytes) -> None:
    """Raise BadInput for a file that is known to be no table of text, by its first bytes, with the
    way out.
    """
    for sign, (what, way_out) in FOREIGN.items():
        if beginning.startswith(sign):
            raise BadInput(f"{path}: is {what}; {way_out}")
    if beginning.startswith(_ZIP):
        what, way_out = _OF_ZIP.get(path.suffix.lower(), ("a zip archive", "unpack it"))
        raise BadInput(f"{path}: is {what}; {way_out}")
    if beginning.startswith(ROS_1_BAG):
        raise BadInput(f"{path}: is a ROS 1 bag; {NO_TABLE}")
    can_log = find_can_log(beginning)
    if can_log:
        raise BadInput(f"{path}: is a CAN log ({can_log}); {NO_TABLE}")
    if _CANDUMP_ON_SCREEN.match(beginning.decode("latin-1")):
        raise BadInput(
            f"{path}: is what candump prints on the screen; record with candump -l, which writes a "
            "log that can be read"
        )


def find_can_log(beginning: bytes) -> str:
    """The kind of a CAN log by its first bytes; "" for other files."""
    if beginning.startswith(_BLF_SIGN):
        return BLF
    text = beginning.decode("latin-1")
    for kind, first_lines in _CAN_TEXT.items():
        if first_lines.match(text):
            return kind
    return ""


def read_gzip(path: Path, most_bytes: int) -> bytes:
    """The content of a gzip file. Raises BadInput where it is damaged or larger than allowed."""
    try:
        with gzip.open(path) as file:
            content = file.read(most_bytes + 1)
    except (OSError, EOFError) as error:
        raise BadInput(f"{path}: cannot be unpacked: {error}") from None
    if len(content) > most_bytes:
        raise BadInput(
            f"{path}: has more than {most_bytes / 1e6:.0f} MB when it is unpacked; split it"
        )
    return content
