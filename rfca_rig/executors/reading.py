"""Reads a file from elsewhere in a copy of this process with limits of time and memory, so that no
file can hang or exhaust this one.

The copy costs about 10 ms. Where the system makes no copies (Windows, macOS), files are read in
this process, without limits.
"""

import faulthandler
import gc
import os
import pickle
import select
import signal
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import NoReturn, TypeVar, cast

from rfca_rig.errors import BadInput, RigError
from rfca_rig.executors.parallel import CAN_COPY

Result = TypeVar("Result")

# Variables of the environment, not keys of a file: a file from elsewhere must not raise the limits
# under which it is read.
TIME_VARIABLE = "RFCA_RIG_READ_S"
MEMORY_VARIABLE = "RFCA_RIG_READ_GIB"
DEFAULT_TIME_S = 10.0
DEFAULT_MEMORY_GIB = 2.0
BYTES_PER_GIB = 2**30

OUT_OF_MEMORY = 3
PIECE_BYTES = 2**20


@dataclass(frozen=True)
class ReadingLimits:
    """How long reading a file may take, and how much memory beyond that of this process."""

    time_s: float
    memory_GiB: float


def reading_limits() -> ReadingLimits:
    """The limits that the environment states. Raises BadInput for a value that is no limit."""
    return ReadingLimits(
        _limit(TIME_VARIABLE, DEFAULT_TIME_S), _limit(MEMORY_VARIABLE, DEFAULT_MEMORY_GIB)
    )


def _limit(variable: str, default: float) -> float:
    text = os.environ.get(variable, "")
    try:
        value = float(text) if text else default
    except ValueError:
        value = 0.0
    # Also false for NaN.
    if not 0.0 < value <= 1e6:
        raise BadInput(
            f"{variable} is {text!r}; set it to a number above 0 and up to 1e6, or unset "
            f"it for {default:g}"
        )
    return value


def read_within_limits(path: Path, read: Callable[[], Result]) -> Result:
    """Returns what `read` returns, from a copy of this process.

    Parameters
    ----------
    path
        The file, for messages.
    read
        Reads it. The result can be pickled; whatever else `read` changes in memory, or prints, is
        lost.

    Raises
    ------
    BadInput
        Where reading takes more time or memory than allowed, or ends the copy.
    RigError
        What `read` raises.
    """
    if not CAN_COPY:
        return read()
    limits = reading_limits()
    # Removed here, since a copy that takes too long is killed and removes nothing.
    with TemporaryDirectory(prefix="rfca-rig-") as scratch:
        return _read_in_copy(path, read, limits, scratch)


def _read_in_copy(
    path: Path, read: Callable[[], Result], limits: ReadingLimits, scratch: str
) -> Result:
    """As `read_within_limits`; what the copy unpacks lies in the folder `scratch`."""
    ours, theirs = os.pipe()
    # Newer interpreters warn of every copy of a process with threads. The copy needs no lock that
    # another thread may hold.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        copy = os.fork()
    if copy == 0:
        _answer(theirs, read, limits, scratch)
    os.close(theirs)
    answer = None
    try:
        answer = _receive(ours, monotonic() + limits.time_s)
    finally:
        os.close(ours)
        if answer is None:
            os.kill(copy, signal.SIGKILL)
        _, status = os.waitpid(copy, 0)
    way_out = f"if it is as it should be, raise {TIME_VARIABLE} or {MEMORY_VARIABLE}"
    if answer is None:
        raise BadInput(f"{path}: takes more than {limits.time_s:g} s to read; {way_out}")
    if os.waitstatus_to_exitcode(status) == 0:
        is_result, content = pickle.loads(answer)
        if not is_result:
            kind, message = content
            raise kind(message)
        return cast(Result, content)
    # A library that gets no memory often ends its process.
    raise BadInput(
        f"{path}: cannot be read within {limits.memory_GiB:g} GiB of memory, or ends the "
        f"program that reads it; {way_out}"
    )


def _receive(pipe: int, until_s: float) -> bytes | None:
    """Everything that comes through the pipe; None where it does not end in time."""
    pieces: list[bytes] = []
    while True:
        ready, _, _ = select.select([pipe], [], [], max(until_s - monotonic(), 0.0))
        if not ready:
            return None
        piece = os.read(pipe, PIECE_BYTES)
        if not piece:
            return b"".join(pieces)
        pieces.append(piece)


def _answer(pipe: int, read: Callable[[], object], limits: ReadingLimits, scratch: str) -> NoReturn:
    """Runs in the copy, and ends it: nothing of this process may run twice, such as its exit
    handlers.
    """
    try:
        _limit_copy(limits)
        tempfile.tempdir = scratch
        try:
            answer = pickle.dumps((True, read()), pickle.HIGHEST_PROTOCOL)
        except RigError as error:
            # Its kind and its words: a library may have taught pickle to keep the cause of an
            # error, which need not be readable again.
            answer = pickle.dumps((False, (type(error), str(error))))
        with open(pipe, "wb") as sending:
            sending.write(answer)
        os._exit(0)
    except MemoryError:
        os._exit(OUT_OF_MEMORY)
    # Any other end of the copy, without an answer, is reported by the first process.
    finally:
        os._exit(1)


def _limit_copy(limits: ReadingLimits) -> None:
    import resource  # noqa: PLC0415  (not on Windows)

    # The search for unused circles would visit all objects of the first process, and so copy their
    # memory.
    gc.freeze()
    # ^C is for the first process, which then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries print several lines before they give up; the first process reports one.
    faulthandler.disable()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    taken = (
        int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        * resource.getpagesize()
    )
    allowed = taken + int(limits.memory_GiB * BYTES_PER_GIB)
    resource.setrlimit(resource.RLIMIT_AS, (allowed, allowed))
    # What is unpacked to disk may be as large as what is unpacked to memory.
    unpacked = int(limits.memory_GiB * BYTES_PER_GIB)
    resource.setrlimit(resource.RLIMIT_FSIZE, (unpacked, unpacked))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
