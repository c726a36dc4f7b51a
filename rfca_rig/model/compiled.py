"""Compiles a function, and keeps the result on disk for the next process.

The compiler's own cache notices an edit only in the file of the function itself, not in the files it calls. Here the cache
folder is named after the content of all compiled files of this package and of `mechanism`, so an edited package never runs stale
code.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., object])

_settings = cast(Any, numba.config)
_njit = cast(Any, numba.njit)
_jitable = cast(Any, register_jitable)

AS_ALL = {"nogil": True, "error_model": "numpy"}
WITHOUT_COUNTING = {"_nrt": False}
WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def cache_folder() -> str:
    """Where compiled code of this very source is kept; NUMBA_CACHE_DIR decides the parent where it is set."""
    content = hashlib.sha256()
    here = Path(__file__).parent
    for source in sorted(path for folder in (here, here.parent / "mechanism") for path in folder.glob("*.py")):
        text = source.read_bytes()
        if b"model.compiled import" in text or source.name == "state.py":
            content.update(text)
    parent = os.environ.get("NUMBA_CACHE_DIR") or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rfca-rig"
    return str(Path(parent) / f"compiled-{content.hexdigest()[:16]}")


CACHE_FOLDER = cache_folder()


def is_warm() -> bool:
    """Whether an earlier process has left compiled code of this source; without it the first stroke takes up to a minute.

    The folder alone says nothing: it is made as soon as a function is marked to be compiled.
    """
    return any(Path(CACHE_FOLDER).rglob("*.nbi"))


def compiled(function: Function) -> Function:
    """`function` as machine code; releases the interpreter lock, so threads run it side by side.

    It must not make arrays. In return nothing counts who holds the arrays that it hands on, which would take as long as the work.
    """
    return _compiled(function, WITHOUT_COUNTING)


def compiled_allocating(function: Function) -> Function:
    """The same for functions that make arrays, and so have to count who holds them, but hand none of them back.

    Handing back an array calls the interpreter, in which a ^C may be raised; the compiler does not look whether one was, and
    the process ends by a segmentation fault. What a caller is to get, it brings.
    """
    return _compiled(function, {})


def internal(function: Function) -> Function:
    """`function` as machine code for compiled callers only; the interpreter runs it as it stands.

    The way from the interpreter into a function with some dozens of arguments takes longer to compile than the function.
    """
    return cast(Function, _jitable(**AS_ALL, **WITHOUT_COUNTING, **WITHOUT_WRAPPERS)(function))


def inlined(function: Function) -> Function:
    """The same, put into its callers: handing a tuple of many arrays to a small function takes longer than the function."""
    return cast(Function, _jitable(**AS_ALL, **WITHOUT_COUNTING, **WITHOUT_WRAPPERS, forceinline=True)(function))


def _compiled(function: Function, options: dict[str, bool]) -> Function:
    with caching_in(CACHE_FOLDER):
        return cast(Function, _njit(cache=True, **AS_ALL, **options)(function))


_CACHE_DIR_LOCK = Lock()


@contextmanager
def caching_in(folder: str) -> Iterator[None]:
    """Compiled code goes to this folder. One thread at a time: the compiler reads the folder from a setting of the whole process."""
    with _CACHE_DIR_LOCK:
        others = _settings.CACHE_DIR
        _settings.CACHE_DIR = folder
        try:
            yield
        finally:
            _settings.CACHE_DIR = others
