"""Files that are either there and whole, or not there: written beside the target, forced to disk, then renamed.

Whatever is recorded reaches the disk through the functions of this file and through no others.
"""

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rfca_rig.errors import DiskFull, RigError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FORCED_EVERY_BYTES = 32 << 20
_BINARY = getattr(os, "O_BINARY", 0)


def write_atomically(path: Path, content: bytes) -> None:
    """Puts `content` at `path`; what stood there stays until the new file is on disk.

    Beside the target, because a rename is atomic only within one file system. Raises RigError when the disk refuses, DiskFull where
    that is because it is full.
    """
    partial = path.with_name(path.name + ".writing")
    with refusals(path, f"{1e-6 * len(content):.1f} MB cannot be written"):
        try:
            _write(partial, content)
            os.replace(partial, path)  # noqa: PTH105
            sync_folder(path.parent)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(partial)  # noqa: PTH108


@contextmanager
def refusals(path: Path, what: str) -> Iterator[None]:
    """What the system refuses inside the block, as an error in one line."""
    try:
        yield
    except OSError as error:
        kind = DiskFull if error.errno in _FULL else RigError
        raise kind(f"{path}: {what}: {error.strerror}") from None


def _write(path: Path, content: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666)
    try:
        _put(handle, content)
        os.fsync(handle)
    finally:
        os.close(handle)


def _put(handle: int, content: bytes | memoryview) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(handle, rest) :]


def sync_folder(folder: Path) -> None:
    """Forces the folder's list of names to disk: without it a rename may be lost with the power. Windows has no such call."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove(path: Path) -> None:
    """Takes a file away; nothing happens where there is none."""
    with refusals(path, "cannot be removed"), suppress(FileNotFoundError):
        os.unlink(path)  # noqa: PTH108


class GrowingFile:
    """A file that only ever grows; what `append` has returned from survives this process, what `force` has, a power cut."""

    def __init__(self, path: Path) -> None:
        """Goes on behind what is there."""
        self.path = path
        with refusals(path, "cannot be opened"):
            self.handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | _BINARY, 0o666)
            self._length = os.fstat(self.handle).st_size

    def append(self, content: bytes) -> None:
        """All of it, or nothing: what the disk refused half is cut off again. Raises RigError, DiskFull."""
        with refusals(self.path, f"{1e-6 * len(content):.1f} MB cannot be added"):
            try:
                _put(self.handle, content)
            except OSError:
                os.ftruncate(self.handle, self._length)
                raise
        self._length += len(content)

    def cut_to(self, length: int) -> None:
        """Drops what stands behind that many bytes."""
        with refusals(self.path, "cannot be cut"):
            os.ftruncate(self.handle, length)
        self._length = length

    def reserve(self, size: int) -> None:
        """Takes room for that many bytes in all, which stay without meaning."""
        with refusals(self.path, f"no room for {1e-6 * size:.1f} MB in reserve"):
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(self.handle, 0, size)
            else:
                _put(self.handle, bytes(size))

    def force(self) -> None:
        """Returns when everything is on disk."""
        with refusals(self.path, "cannot be forced to disk"):
            os.fsync(self.handle)

    def close(self) -> None:
        os.close(self.handle)


class RoughFile:
    """A file under construction, for a writer that goes back and forth in it and cannot bear a refusal: HDF5.

    HDF5 that fails to close a file can take the whole process down when that exits (h5py issue 914). So what the disk refuses, and
    all that comes after it, stays in memory; `check` raises it. The file stands beside `path` until `put_in_place`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.partial = path.with_name(path.name + ".writing")
        with refusals(path, "cannot be begun"):
            self._handle = os.open(self.partial, os.O_RDWR | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666)
        self._at = self._size = self._forced = 0
        self._refused: OSError | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def write(self, content: memoryview) -> int:
        at, self._at = self._at, self._at + len(content)
        self._size = max(self._size, self._at)
        if self._refused is None:
            self._attempt(at, content)
        if self._refused is not None:
            self._unwritten.append((at, bytes(content)))
        return len(content)

    def _attempt(self, at: int, content: memoryview) -> None:
        try:
            os.lseek(self._handle, at, os.SEEK_SET)
            _put(self._handle, content)
        except OSError as error:
            self._refused = error

    def readinto(self, target: memoryview) -> int:
        found = self.read(len(target))
        target[: len(found)] = found
        return len(found)

    def read(self, length: int = -1) -> bytes:
        """From where it stands; shorter at the end."""
        at, end = self._at, self._size if length < 0 else min(self._at + length, self._size)
        os.lseek(self._handle, at, os.SEEK_SET)
        found = bytearray(os.read(self._handle, end - at).ljust(end - at, b"\0"))
        for start, content in self._unwritten:
            first, last = max(start, at), min(start + len(content), end)
            if first < last:
                found[first - at : last - at] = content[first - start : last - start]
        self._at = end
        return bytes(found)

    def truncate(self, size: int) -> None:
        """Sets its length; nothing of it was left unused."""
        self._size = size
        if self._refused is None:
            try:
                os.ftruncate(self._handle, size)
            except OSError as error:
                self._refused = error

    def flush(self) -> None:
        """What was written is with the system already."""

    def check(self) -> None:
        """Raises what the disk refused, as RigError or DiskFull. Now and then forces to disk what is there, so that the end is quick."""
        with refusals(self.path, f"{1e-6 * self._size:.1f} MB cannot be written"):
            if self._refused is not None:
                raise self._refused
            if self._size - self._forced > FORCED_EVERY_BYTES:
                os.fsync(self._handle)
                self._forced = self._size

    def put_in_place(self) -> None:
        """Returns when the file is at `path`, and on disk. Raises RigError, DiskFull."""
        self.check()
        with refusals(self.path, f"{1e-6 * self._size:.1f} MB cannot be written"):
            os.fsync(self._handle)
            self._close()
            os.replace(self.partial, self.path)  # noqa: PTH105
            sync_folder(self.path.parent)

    def discard(self) -> None:
        """Takes it away, unless it has been put in place. May be called any number of times."""
        if self._handle >= 0:
            self._close()
            remove(self.partial)

    def _close(self) -> None:
        handle, self._handle = self._handle, -1
        os.close(handle)


def make_folder_atomically(folder: Path, fill: Callable[[Path], object]) -> None:
    """Makes `folder`, with what `fill` writes into it, all or nothing; folders above it are made, and taken away on failure.

    `folder` must not exist. Whatever `fill` raises passes on after everything is cleared away.
    """
    made = [above for above in folder.parents if not above.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.writing-{os.getpid()}")
    try:
        partial.mkdir()
        fill(partial)
        partial.rename(folder)
        sync_folder(folder.parent)
    except BaseException:
        _remove(partial)
        for above in made:
            above.rmdir()
        raise


def _remove(folder: Path) -> None:
    if folder.is_dir():
        for file in folder.iterdir():
            if file.is_dir():
                _remove(file)
            else:
                file.unlink()
        folder.rmdir()
