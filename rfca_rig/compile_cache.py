"""Compiled code on disk for the next process.

The compiler's own cache trusts its files: one that is empty, cut or exchanged raises an error
wherever the function is first called, or runs the wrong code. Here each entry is a file that begins
with a hash of what it is for and of its content. An entry that does not match, or cannot be read,
counts as none: the function is compiled again and the entry replaced.
"""

import hashlib
import logging
import pickle
import shutil
import stat
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from threading import Event
from typing import Any, cast
from uuid import uuid4

import llvmlite
import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

SUFFIX = ".nbc"
SEAL_BYTES = hashlib.sha256().digest_size
# The largest entry of the package has 3 MB. Anything above is no entry, and is not read into
# memory.
MAX_ENTRY_BYTES = 64 * 2**20
# Code of another version may fit the function, but not the library that it calls.
VERSIONS = (
    f"{sys.version} numba {numba.__version__} llvmlite {llvmlite.__version__} numpy "
    f"{np.__version__}"
)

_log = logging.getLogger(__name__)
_was_reported = Event()


class CodeCache(NullCache):
    """Compiled code of one function, in a file for each signature. It replaces `_cache` of a
    function that numba compiles.
    """

    def __init__(self, function: Callable[..., object], folder: Path) -> None:
        self._function = function
        self._folder = folder

    @property
    def cache_path(self) -> str:
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # What the code of functions with arrays of their own refers to. The compiler's own library
        # of functions, which takes 0.2 s to import, is not needed before something must be
        # compiled.
        cast(Any, rtsys).initialize(target_context)
        path, purpose = self._entry_of(sig, target_context.codegen())
        content = _read_entry(path, purpose)
        if content is None:
            return None
        return cast(Any, CompileResult)._rebuild(target_context, *pickle.loads(content))

    def save_overload(self, sig: Any, cres: Any) -> None:
        # Such code refers to addresses of this process.
        if cres.library.has_dynamic_globals:
            return
        path, purpose = self._entry_of(sig, cres.codegen)
        content = cast(Any, dumps)(cres._reduce())
        try:
            _write_entry(path, _seal(purpose, content) + content)
        except OSError as error:
            _report_once(
                "compiled code cannot be kept, so the next program compiles it again: "
                f"{path.parent}: {error.strerror}"
            )

    def _entry_of(self, sig: Any, codegen: Any) -> tuple[Path, bytes]:
        """The file of the entry, and all that its code depends on."""
        code = self._function.__code__
        values = tuple(cell.cell_contents for cell in self._function.__closure__ or ())
        purpose = b"\n".join(
            (
                f"{VERSIONS} {codegen.magic_tuple()}".encode(),
                f"{self._function.__module__}.{self._function.__qualname__} {sig}".encode(),
                _hash_source(code.co_filename),
                code.co_code,
                cast(bytes, cast(Any, dumps)(values)) if values else b"",
            )
        )
        name = f"{self._function.__module__}.{self._function.__qualname__}".removeprefix(
            "rfca_rig."
        ).replace("<locals>", "locals")
        return self._folder / f"{name}-{hashlib.sha256(purpose).hexdigest()[:16]}{SUFFIX}", purpose


@cache
def _hash_source(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


def _seal(purpose: bytes, content: bytes) -> bytes:
    return hashlib.sha256(hashlib.sha256(purpose).digest() + content).digest()


def _read_entry(path: Path, purpose: bytes) -> bytes | None:
    """The content of an entry; None where there is none, or none that can be used."""
    try:
        status = path.stat()
        # A pipe would wait for somebody to write into it.
        if stat.S_ISREG(status.st_mode) and status.st_size <= MAX_ENTRY_BYTES:
            entry = path.read_bytes()
            content = entry[SEAL_BYTES:]
            if entry[:SEAL_BYTES] == _seal(purpose, content):
                return content
    except FileNotFoundError:
        return None
    except OSError as error:
        _report_once(
            f"compiled code cannot be read and is compiled again: {path}: {error.strerror}"
        )
        return None
    _report_once(f"compiled code was damaged and is compiled again: {path}")
    return None


def _write_entry(path: Path, entry: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    temporary = path.with_name(f"{path.name}.{uuid4().hex[:16]}.tmp")
    try:
        temporary.write_bytes(entry)
        # Several processes may compile the same function; each replaces the entry as a whole.
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _report_once(text: str) -> None:
    """One line in a process: what damages one entry often damages all."""
    if not _was_reported.is_set():
        _was_reported.set()
        _log.warning(text)
