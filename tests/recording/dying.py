"""Disks and processes that fail at a chosen moment, behind the one place through which
everything recorded is written.
"""

import errno
import os
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.recording import atomic

COUNTED = ("open", "write", "fsync", "replace", "ftruncate", "unlink", "posix_fallocate")
DEAD = 9


class CountingOs:
    """The module `os`, with every call counted that changes the disk; at the last one it may
    have, `die` is called instead.
    """

    def __init__(self, last: int, die: Callable[[str, tuple], object]) -> None:
        self.calls = 0
        self._last = last
        self._die = die

    def __getattr__(self, name: str):
        real = getattr(os, name)
        if name in COUNTED:
            return self._counted(name, real)
        return real

    def _counted(self, name: str, real):
        def call(*words):
            self.calls += 1
            if self.calls == self._last:
                return self._die(name, words)
            return real(*words)

        return call


def torn(name: str, words: tuple) -> None:
    """Ends the process; a write gets half way first."""
    if name == "write":
        handle, content = words
        os.write(
            handle, content[: np.random.default_rng(len(content)).integers(0, len(content) + 1)]
        )
    os._exit(DEAD)


@dataclass(frozen=True)
class Promised:
    """What a run had been told when it died: ticks handed over, stages acknowledged."""

    ticks: int
    stages: int


TICK = b"t"
STAGE = b"s"
Work = Callable[[Callable[[bytes], object]], None]


def calls_of(work: Work) -> int:
    """How many calls it makes when nothing goes wrong."""
    counting = CountingOs(-1, torn)
    with instead(counting):
        work(lambda _: None)
    return counting.calls


@contextmanager
def instead(other_os):
    before = atomic.os
    atomic.os = other_os
    try:
        yield
    finally:
        atomic.os = before


def killed_at(call: int, work: Work) -> Promised:
    """Runs `work` in a child that dies in its n-th call; returns how often `work` had told of a
    TICK and of a STAGE.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            atomic.os = CountingOs(call, torn)
            work(lambda told: os.write(writing, told))
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as said:
        told = said.read()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == DEAD
    return Promised(told.count(TICK), told.count(STAGE))


class BrokenStageFile:
    """The module `os` on a disk that cannot write the file of a stage: any error but a full
    disk.
    """

    def __getattr__(self, name: str):
        return getattr(os, name)

    def open(self, path: Path, *words) -> int:
        if path.name.endswith(".h5.writing"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return os.open(path, *words)


class FullDisk:
    """The module `os` on a disk that holds so many bytes in `folder`, and not one more."""

    def __init__(self, folder: Path, room: int) -> None:
        self._folder = folder
        self.room = room

    def __getattr__(self, name: str):
        return getattr(os, name)

    @property
    def used(self) -> int:
        return sum(file.stat().st_size for file in self._folder.rglob("*") if file.is_file())

    def write(self, handle: int, content: bytes) -> int:
        left = self.room - self.used
        if left <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.write(handle, content[:left])

    def posix_fallocate(self, handle: int, offset: int, size: int) -> None:
        if self.used + size > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.posix_fallocate(handle, offset, size)
