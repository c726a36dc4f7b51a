"""Atomic writes: a file or folder is either complete or absent. It is written beside its target,
forced to disk, then renamed.

All recorded data reaches the disk through the functions of this module only.
"""

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from stat import S_ISDIR, S_ISREG

from rfca_rig.errors import BadInput, DiskFull, RigError

# A full disk, a used-up quota and a file above the system's size limit all need the same remedy:
# room.
_DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# A large file is forced to disk piece by piece, so that the last fsync, for which the run waits, is
# short.
SYNC_EVERY_BYTES = 32 << 20
# Windows would otherwise translate line ends; other systems have no such flag.
_BINARY = getattr(os, "O_BINARY", 0)

ENDING = ".writing"


def write_atomically(path: Path, content: bytes) -> None:
    """Writes `content` to `path`; an existing file stays until the new one is on disk.

    Raises RigError where the disk refuses and for anything that is no file, DiskFull where it is
    full.
    """
    refuse_devices(path)
    # Beside the target: a rename is atomic only within one file system.
    partial = path.with_name(path.name + ".writing")
    with translate_os_errors(path, f"{1e-6 * len(content):.1f} MB cannot be written"):
        try:
            # Order: content on disk, rename, folder on disk. A power cut leaves the old file or the
            # new one, never a part.
            _write(partial, content)
            os.replace(partial, path)  # noqa: PTH105
            sync_folder(path.parent)
        finally:
            # After a success the name is gone; after a failure nothing half written stays behind.
            with suppress(FileNotFoundError):
                os.unlink(partial)  # noqa: PTH108


def refuse_devices(path: Path) -> None:
    """Raises BadInput for a device or a pipe, also behind a link: a rename would put a file in
    its place, /dev/null's for instance.
    """
    with translate_os_errors(path, "cannot be written"):
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            return
        except NotADirectoryError as error:
            raise BadInput(
                f"{path}: cannot be written: {error.strerror}; name a file in a folder"
            ) from None
    if not S_ISREG(mode) and not S_ISDIR(mode):
        raise BadInput(f"{path}: is a device or a pipe, where a file is needed; name another file")


@contextmanager
def translate_os_errors(path: Path, what: str) -> Iterator[None]:
    """Turns an OSError inside the block into a RigError of one line, or DiskFull."""
    try:
        yield
    except OSError as error:
        # `from None`: users see one line; the system's error text is in it.
        kind = DiskFull if error.errno in _DISK_FULL_ERRNOS else RigError
        raise kind(f"{path}: {what}: {error.strerror}") from None


def _write(path: Path, content: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666)
    try:
        _write_all(handle, content)
        os.fsync(handle)
    finally:
        os.close(handle)


def _write_all(handle: int, content: bytes | memoryview) -> None:
    rest = memoryview(content)
    while rest:
        # os.write may take only a part, on a nearly full disk or after a signal.
        rest = rest[os.write(handle, rest) :]


def sync_folder(folder: Path) -> None:
    """Forces the folder's list of names to disk: without it a power cut may undo a rename.
    Windows has no such call.
    """
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove(path: Path) -> None:
    """Removes a file; does nothing where there is none."""
    with translate_os_errors(path, "cannot be removed"), suppress(FileNotFoundError):
        os.unlink(path)  # noqa: PTH108


class AppendOnlyFile:
    """An append-only file. What `append` has returned from survives the end of this process;
    what `force` has, a power cut.
    """

    def __init__(self, path: Path) -> None:
        """Continues behind the existing content."""
        self.path = path
        with translate_os_errors(path, "cannot be opened"):
            self.handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | _BINARY, 0o666)
            self._length = os.fstat(self.handle).st_size

    def append(self, content: bytes) -> None:
        """Appends all of `content` or nothing. Raises RigError, DiskFull."""
        with translate_os_errors(self.path, f"{1e-6 * len(content):.1f} MB cannot be added"):
            try:
                _write_all(self.handle, content)
            except OSError:
                # A block written in part would end the journal for every reader: nothing behind it
                # would be found.
                os.ftruncate(self.handle, self._length)
                raise
        self._length += len(content)

    def cut_to(self, length: int) -> None:
        """Drops everything behind the first `length` bytes."""
        with translate_os_errors(self.path, "cannot be cut"):
            os.ftruncate(self.handle, length)
        self._length = length

    def reserve(self, size: int) -> None:
        """Allocates `size` bytes in all, with arbitrary content."""
        with translate_os_errors(self.path, f"no room for {1e-6 * size:.1f} MB in reserve"):
            # Real blocks are needed: seeking to the end would make a sparse file, which reserves
            # nothing.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(self.handle, 0, size)
            else:
                _write_all(self.handle, bytes(size))

    def force(self) -> None:
        """Returns when everything written so far is on disk."""
        with translate_os_errors(self.path, "cannot be forced to disk"):
            os.fsync(self.handle)

    def close(self) -> None:
        os.close(self.handle)


class ErrorDeferringFile:
    """A file under construction for HDF5, which seeks in it and must never see a write fail.

    HDF5 that fails to close a file can take the whole process down at exit (h5py issue 914). So a
    refused write, and all later ones, stay in memory; `check` raises the error. The file stands
    beside `path` until `put_in_place`.
    """

    def __init__(self, path: Path) -> None:
        refuse_devices(path)
        self.path = path
        self.partial = path.with_name(path.name + ".writing")
        with translate_os_errors(path, "cannot be begun"):
            self._handle = os.open(
                self.partial, os.O_RDWR | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666
            )
        self._at = self._size = self._forced = 0
        self._refused: OSError | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def write(self, content: memoryview) -> int:
        at = self._at
        self._at = self._at + len(content)
        self._size = max(self._size, self._at)
        if self._refused is None:
            self._attempt(at, content)
        if self._refused is not None:
            # HDF5 reads back what it wrote, so the refused bytes must stay available until the file
            # is discarded.
            self._unwritten.append((at, bytes(content)))
        return len(content)

    def _attempt(self, at: int, content: memoryview) -> None:
        try:
            os.lseek(self._handle, at, os.SEEK_SET)
            _write_all(self._handle, content)
        except OSError as error:
            self._refused = error

    def readinto(self, target: memoryview) -> int:
        content = self.read(len(target))
        target[: len(content)] = content
        return len(content)

    def read(self, length: int = -1) -> bytes:
        """Reads from the current position; shorter at the end of the file. Sees refused writes
        too.
        """
        at = self._at
        if length < 0:
            end = self._size
        else:
            end = min(self._at + length, self._size)
        os.lseek(self._handle, at, os.SEEK_SET)
        # Bytes that HDF5 never wrote, or that only stand in memory, are not in the file: they read
        # as zeros.
        buffer = bytearray(os.read(self._handle, end - at).ljust(end - at, b"\0"))
        # In the order of writing: a later write to the same place wins.
        for start, content in self._unwritten:
            first = max(start, at)
            last = min(start + len(content), end)
            if first < last:
                buffer[first - at : last - at] = content[first - start : last - start]
        self._at = end
        return bytes(buffer)

    def truncate(self, size: int) -> None:
        """Sets the file's length."""
        self._size = size
        if self._refused is None:
            try:
                os.ftruncate(self._handle, size)
            except OSError as error:
                self._refused = error

    def flush(self) -> None:
        """Does nothing: every write goes to the system at once."""

    def check(self) -> None:
        """Raises what the disk refused, as RigError or DiskFull. Forces larger pieces to disk,
        so that the end is quick.
        """
        with translate_os_errors(self.path, f"{1e-6 * self._size:.1f} MB cannot be written"):
            if self._refused is not None:
                raise self._refused
            if self._size - self._forced > SYNC_EVERY_BYTES:
                os.fsync(self._handle)
                self._forced = self._size

    def put_in_place(self) -> None:
        """Returns when the file is at `path` and on disk. Raises RigError, DiskFull."""
        self.check()
        with translate_os_errors(self.path, f"{1e-6 * self._size:.1f} MB cannot be written"):
            os.fsync(self._handle)
            self._close()
            os.replace(self.partial, self.path)  # noqa: PTH105
            sync_folder(self.path.parent)

    def discard(self) -> None:
        """Removes the file, unless it has been put in place. May be called any number of times."""
        if self._handle >= 0:
            self._close()
            remove(self.partial)

    def _close(self) -> None:
        handle = self._handle
        self._handle = -1
        os.close(handle)


def make_folder_atomically(folder: Path, fill: Callable[[Path], object]) -> None:
    """Makes `folder` with what `fill` writes into it, all or nothing. Parent folders are made, and
    removed on failure.

    `folder` must not exist. An exception of `fill` passes on after everything is cleared away.
    """
    made = [above for above in folder.parents if not above.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Hidden, so that no listing shows it; with the process id, so that two processes do not share
    # it.
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


@contextmanager
def atomic_directory(folder: Path) -> Iterator[Path]:
    """Yields a path to write the folder at; it gets its final name at the end of the block.

    Where another process was faster, for example a worker that counted as lost, the existing folder
    stays.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    # A random part, not the process id: workers on several computers may share the disk.
    partial = folder.with_name(f".{folder.name}.{token_hex(4)}{ENDING}")
    try:
        yield partial
        if not folder.is_dir():
            partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def remove_leftovers(folder: Path) -> None:
    """Removes what earlier processes were writing when they ended."""
    for partial in folder.glob(f".*{ENDING}"):
        shutil.rmtree(partial, ignore_errors=True)


def refresh_nfs_cache(folder: Path) -> None:
    """Makes a network disk show new files: it may remember for half a minute that they were
    absent, until the folder is changed here.
    """
    mark = folder / f".seen-{token_hex(4)}"
    mark.touch()
    mark.unlink()
