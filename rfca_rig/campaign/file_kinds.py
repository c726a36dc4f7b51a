"""What a file is by its first bytes, and the way out for one that cannot be read.

The ending of a name says what somebody meant; the first bytes say what is there.
"""

import gzip
from collections.abc import Mapping
from pathlib import Path

import h5py

from rfca_rig.errors import BadInput

GZIP = b"\x1f\x8b"
MATLAB_5 = b"MATLAB 5.0 MAT-file"
# As far as any of these signs lies from the beginning: that of a tar archive.
LOOKED_AT = 512

DECODE_CAN = "decode its signals to CSV: python-can reads it, cantools decodes"
# The first bytes of a kind of file, what it is, and how to make a readable one of it.
FOREIGN: Mapping[bytes, tuple[str, str]] = {
    b"#ROSBAG V": ("a ROS 1 bag", "rosbags-convert makes a ROS 2 bag of it"),
    b"\x28\xb5\x2f\xfd": ("compressed by zstd", "unpack it: zstd -d"),
    b"BZh": ("compressed by bzip2", "unpack it: bunzip2"),
    b"\xfd7zXZ\x00": ("compressed by xz", "unpack it: unxz"),
    b"7z\xbc\xaf\x27\x1c": ("a 7-Zip archive", "unpack it"),
    b"LOGG": ("a CAN log (BLF)", DECODE_CAN),
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
# Text of CAN logs: what their first line begins with.
_CAN_TEXT = {
    "candump": "(",
    "Vector ASC": "date ",
}


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, whatever its name says; MATLAB's v7.3 is."""
    return path.is_file() and bool(h5py.is_hdf5(path))


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
    first_line = beginning.split(b"\n", 1)[0].decode("latin-1")
    for log, start in _CAN_TEXT.items():
        if first_line.startswith(start) and _is_can_log(log, first_line):
            raise BadInput(f"{path}: is a CAN log ({log}); {DECODE_CAN}")


def _is_can_log(log: str, first_line: str) -> bool:
    """Whether a line is that of such a log, and no name of a column that begins alike."""
    words = first_line.split()
    if log == "candump":
        # "(1714500000.000000) can0 029#BC46 R"
        return len(words) in (3, 4) and words[0].endswith(")") and "#" in words[2]
    # "date Wed May 01 12:00:00 2024"
    return len(words) >= 5 and "," not in first_line


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
