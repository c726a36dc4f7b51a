"""Decorators that compile a function with numba and cache the result on disk for the next process.

The compiler's own cache notices an edit only in the file of the function itself, not in the files it calls. Here the cache
folder is named after the content of all compiled files of this package and of `mechanism`, so an edited package never runs outdated
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

from rfca_rig.model.kernel.linking import LinkingCallees, PartOfCallers

Function = TypeVar("Function", bound=Callable[..., object])

_settings = cast(Any, numba.config)
_njit = cast(Any, numba.njit)
_jitable = cast(Any, register_jitable)

# "numpy": a division by zero gives inf or NaN, as in numpy, instead of raising an exception.
AS_ALL = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
# Without numba's runtime no array can be allocated, and no reference to one is counted.
WITHOUT_COUNTING = {"_nrt": False}
WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def cache_folder() -> str:
    """Folder of compiled code of exactly this source; NUMBA_CACHE_DIR decides the parent where it is set."""
    content = hashlib.sha256()
    kernel = Path(__file__).parent
    folders = kernel, kernel.parent, kernel.parents[1] / "mechanism"
    for source in sorted(path for folder in folders for path in folder.glob("*.py")):
        text = source.read_bytes()
        # Neither compiles anything, but `state` has the types of all compiled functions, and `linking` decides what becomes of them.
        if b"kernel.compiled import" in text or source.name in ("state.py", "linking.py"):
            content.update(text)
    parent = os.environ.get("NUMBA_CACHE_DIR") or _cache_of_user() / "rfca-rig"
    return str(Path(parent) / f"compiled-{content.hexdigest()[:16]}")


def _cache_of_user() -> Path:
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    try:
        return Path.home() / ".cache"
    # A user of a container may have neither HOME nor an entry in the system's list. Not the temporary folder: others could put code there.
    except RuntimeError:
        return Path(__file__).parent / "__pycache__"


CACHE_FOLDER = cache_folder()


def is_warm() -> bool:
    """Whether an earlier process has left compiled code of this source; without it the first stroke takes up to a minute.

    That the folder exists proves nothing: it is made as soon as a function is decorated.
    """
    return any(Path(CACHE_FOLDER).rglob("*.nbi"))


def jit(function: Function) -> Function:
    """Compiles `function` without reference counting; it releases the interpreter lock, so threads run it in parallel.

    It must not allocate arrays. Counting references to the arrays that it passes on would take as long as the work itself.
    """
    return _compile(function, WITHOUT_COUNTING)


def jit_allocating(function: Function) -> Function:
    """Compiles a function that allocates arrays, with reference counting; it must not return an array.

    Returning an array calls the interpreter, in which a ^C may raise an exception. The compiled code does not check for it, and
    the process ends by a segmentation fault. So the caller provides the arrays for results.
    """
    return _compile(function, {})


def jit_internal(function: Function) -> Function:
    """Compiles `function` for compiled callers only; the interpreter runs the Python code.

    A wrapper for calls from the interpreter, with some dozens of arguments, takes longer to compile than the function.
    """
    return cast(Function, _jitable(**AS_ALL, **WITHOUT_COUNTING, **WITHOUT_WRAPPERS, pipeline_class=PartOfCallers)(function))


def jit_inline(function: Function) -> Function:
    """As `jit_internal`, inlined in its callers: passing a tuple of many arrays to a small function takes longer than the function."""
    return cast(
        Function, _jitable(**AS_ALL, **WITHOUT_COUNTING, **WITHOUT_WRAPPERS, pipeline_class=PartOfCallers, forceinline=True)(function)
    )


def _compile(function: Function, options: dict[str, bool]) -> Function:
    with caching_in(CACHE_FOLDER):
        # Nothing calls it by a pointer in C.
        return cast(Function, _njit(cache=True, no_cfunc_wrapper=True, **AS_ALL, pipeline_class=LinkingCallees, **options)(function))


_CACHE_DIR_LOCK = Lock()


@contextmanager
def caching_in(folder: str) -> Iterator[None]:
    """Caches compiled code in this folder. One thread at a time: the compiler reads the folder from a setting of the whole process."""
    with _CACHE_DIR_LOCK:
        # Other packages of this process have their own setting, which must come back.
        previous = _settings.CACHE_DIR
        _settings.CACHE_DIR = folder
        try:
            yield
        finally:
            _settings.CACHE_DIR = previous
