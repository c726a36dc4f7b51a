"""Compilation of the exam's simulator by numba."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., object])

_jitable = cast(Any, register_jitable)


def _folder() -> str:
    """Cache folder for the present source of the simulator: numba notices edits in a function's own file only."""
    content = b"".join(source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py")))
    parent = os.environ.get("NUMBA_CACHE_DIR") or str(Path.home() / ".cache" / "rfca-rig")
    return str(Path(parent) / f"exam-{hashlib.sha256(content).hexdigest()[:16]}")


def jit_cached(function: Function) -> Function:
    """The function, compiled on first use and cached on disk; a division by zero gives inf, as in numpy."""
    # numba reads the cache folder when it decorates, so the setting is needed only meanwhile and other packages keep theirs.
    settings = cast(Any, numba.config)
    before, settings.CACHE_DIR = settings.CACHE_DIR, _folder()
    try:
        return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
    finally:
        settings.CACHE_DIR = before


def jit_internal(function: Function) -> Function:
    """The same for compiled callers only. Called from the interpreter, the function runs as plain Python."""
    return cast(Function, _jitable(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function))
