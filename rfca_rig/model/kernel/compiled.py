"""Decorators that compile a function with numba and cache the result on disk for the next process.

A cached function is compiled again after an edit of its own file, not of the files whose functions
it calls. Therefore the cache folder is named after the content of all compiled files of this
package and of `mechanism`, so an edited package never runs outdated code.

The compiler's own library links a callee into its caller at each level of calls, and optimises it
and makes it executable each time. For the equations of motion, ten levels deep, this took 40 s of
processor time. Here each callee goes once into the function that Python calls, which takes 25 s;
the code is as fast.
"""

import hashlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.typed_passes import AnnotateTypes
from numba.extending import register_jitable

from rfca_rig.compile_cache import SUFFIX, CodeCache

Function = TypeVar("Function", bound=Callable[..., object])

_settings = cast(Any, numba.config)
_njit = cast(Any, numba.njit)
_jitable = cast(Any, register_jitable)
_Builder = cast(Any, DefaultPassBuilder)

# "numpy": a division by zero gives inf or NaN, as in numpy, instead of raising an exception.
AS_ALL = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
# Without numba's runtime no array can be allocated, and no reference to one is counted.
WITHOUT_COUNTING = {"_nrt": False}
WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class _Part(JITCodeLibrary):
    """The code of a function that only compiled callers call. It is neither optimised nor made
    executable before it is in its callers.
    """

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        return 0

    @property
    def codegen(self) -> Any:
        # Called to connect the Python objects that a function uses; here there are none, as after
        # loading from the disk.
        return _WithoutObjects()

    def module_alone(self) -> Any:
        """Its own code without that of what it calls."""
        return cast(Any, super())._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        # For a caller that knows nothing of parts, as the law of an effect: with all that it calls.
        merged = self.module_alone().clone()
        _link_parts(merged, _list_callees(self._linking_libraries))
        return merged


class _WithoutObjects:
    def set_env(self, name: str, environment: object) -> None:
        pass


class _Whole(JITCodeLibrary):
    """The code of a function for Python, with all parts that it calls."""

    def finalize(self) -> None:
        _link_parts(self._final_module, _list_callees(self._linking_libraries))
        self._linking_libraries.clear()
        # A leg has seven links: vectors of a loop over them take a sixth of the compilation, and
        # the code is no faster.
        before = _settings.LOOP_VECTORIZE
        _settings.LOOP_VECTORIZE = 0
        try:
            cast(Any, super()).finalize()
        finally:
            _settings.LOOP_VECTORIZE = before


def _list_callees(libraries: Sequence[Any]) -> list[Any]:
    """These libraries, and those that parts among them call, in order of the first call, each
    once.
    """
    callees = dict.fromkeys(libraries)
    waiting = list(callees)
    for library in waiting:
        if isinstance(library, _Part):
            new = [callee for callee in library._linking_libraries if callee not in callees]
        else:
            new = []
        callees |= dict.fromkeys(new)
        waiting += new
    return list(callees)


def _link_parts(module: Any, libraries: Sequence[Any]) -> None:
    for library in libraries:
        if isinstance(library, _Part):
            code = library.module_alone()
        else:
            code = library._get_module_for_linking()
        module.link_in(code, preserve=True)


def _pipeline(library: type) -> type[CompilerBase]:
    """The compiler's passes, with a library of this class for the code."""

    @cast(Any, register_pass)(mutates_CFG=False, analysis_only=True)
    class _ChooseLibrary(AnalysisPass):
        _name = f"choose_library{library.__name__}"

        def __init__(self) -> None:
            # Abstract in the compiler's class.
            pass

        def run_pass(self, state: Any) -> bool:
            state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return False

    class _Pipeline(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            passes = _Builder.define_nopython_pipeline(self.state)
            passes.add_pass_after(_ChooseLibrary, AnnotateTypes)
            passes.finalize()
            return [passes]

    return _Pipeline


# For functions that Python calls, and for those that only compiled functions call.
_LINKING_CALLEES = _pipeline(_Whole)
_PART_OF_CALLERS = _pipeline(_Part)


def cache_folder() -> str:
    """Folder of compiled code of exactly this source; NUMBA_CACHE_DIR decides the parent where
    it is set.
    """
    content = hashlib.sha256()
    kernel = Path(__file__).parent
    folders = kernel, kernel.parent, kernel.parents[1] / "mechanism"
    for source in sorted(path for folder in folders for path in folder.glob("*.py")):
        text = source.read_bytes()
        # `state` compiles nothing, but its tuples are the types of all compiled functions. This
        # file is one that matches, too.
        if b"kernel.compiled import" in text or source.name == "state.py":
            content.update(text)
    parent = os.environ.get("NUMBA_CACHE_DIR") or _cache_of_user() / "rfca-rig"
    return str(Path(parent) / f"compiled-{content.hexdigest()[:16]}")


def _cache_of_user() -> Path:
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    try:
        return Path.home() / ".cache"
    # A user of a container may have neither HOME nor an entry in the system's list. Not the
    # temporary folder: others could put code there.
    except RuntimeError:
        return Path(__file__).parent / "__pycache__"


CACHE_FOLDER = cache_folder()


def is_warm() -> bool:
    """Whether an earlier process has left compiled code of this source; without it the first
    stroke takes up to a minute.
    """
    return any(Path(CACHE_FOLDER).rglob(f"*{SUFFIX}"))


def count_compiled(folder: Path = Path(CACHE_FOLDER)) -> int:
    """Number of functions of which compiled code is kept in the folder."""
    return sum(1 for _ in folder.rglob(f"*{SUFFIX}"))


def jit(function: Function) -> Function:
    """Compiles `function` without reference counting; it releases the interpreter lock, so threads
    run it in parallel.

    It must not allocate arrays. Counting references to the arrays that it passes on would take as
    long as the work itself.
    """
    return _compile(function, WITHOUT_COUNTING)


def jit_allocating(function: Function) -> Function:
    """Compiles a function that allocates arrays, with reference counting; it must not return an
    array.

    Returning an array calls the interpreter, in which a ^C may raise an exception. The compiled
    code does not check for it, and the process ends by a segmentation fault. So the caller provides
    the arrays for results.
    """
    return _compile(function, {})


def jit_internal(function: Function) -> Function:
    """Compiles `function` for compiled callers only; the interpreter runs the Python code.

    A wrapper for calls from the interpreter, with some dozens of arguments, takes longer to compile
    than the function.
    """
    return cast(
        Function,
        _jitable(**AS_ALL, **WITHOUT_COUNTING, **WITHOUT_WRAPPERS, pipeline_class=_PART_OF_CALLERS)(
            function
        ),
    )


def jit_inline(function: Function) -> Function:
    """As `jit_internal`, inlined in its callers: passing a tuple of many arrays to a small
    function takes longer than the function.
    """
    return cast(
        Function,
        _jitable(
            **AS_ALL,
            **WITHOUT_COUNTING,
            **WITHOUT_WRAPPERS,
            pipeline_class=_PART_OF_CALLERS,
            forceinline=True,
        )(function),
    )


def compile_to_llvm(
    function: Callable[..., object], types: tuple[Any, ...], is_law: bool = False
) -> tuple[str, bytes]:
    """Name and LLVM bitcode of `function` for arguments of these types, with all that it calls, for
    a program without Python.

    It must not allocate arrays, as with `jit`. The function of a law gets the options with which
    `laws` compiles it, so that it rounds as here.
    """
    options: dict[str, Any] = {}
    if not is_law:
        options = {**AS_ALL, **WITHOUT_COUNTING}
    dispatcher = _njit(**options, **WITHOUT_WRAPPERS, pipeline_class=_LINKING_CALLEES)(function)
    dispatcher.compile(types)
    compiled = dispatcher.overloads[types]
    return compiled.fndesc.llvm_func_name, compiled.library._final_module.as_bitcode()


def _compile(function: Function, options: dict[str, bool]) -> Function:
    # Nothing calls it by a pointer in C.
    dispatcher = _njit(no_cfunc_wrapper=True, **AS_ALL, pipeline_class=_LINKING_CALLEES, **options)(
        function
    )
    # Without compilation, as for coverage, it is the Python function itself.
    if dispatcher is not function:
        dispatcher._cache = CodeCache(function, Path(CACHE_FOLDER))
    return cast(Function, dispatcher)
