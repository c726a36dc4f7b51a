"""Links compiled functions: each callee goes once into the function that Python calls, and is optimised there.

numba's own library links a callee into its caller at each level of calls, and optimises it and makes it executable each time. For the
equations of motion, ten levels deep, this took 40 s of processor time; linked once, they take 25 s. The code is as fast as before.

Entry points: `LinkingCallees` and `PartOfCallers`, to be passed to numba as `pipeline_class`.
"""

from collections.abc import Sequence
from typing import Any, cast

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.typed_passes import AnnotateTypes

_Builder = cast(Any, DefaultPassBuilder)


class _Part(JITCodeLibrary):
    """The code of a function that only compiled callers call. It is neither optimised nor made executable before it is in its callers."""

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        return 0

    @property
    def codegen(self) -> Any:
        # Called to connect the Python objects that a function uses; here there are none, as after loading from the disk.
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
        cast(Any, super()).finalize()


def _list_callees(libraries: Sequence[Any]) -> list[Any]:
    """These libraries, and those that parts among them call, in order of the first call, each once."""
    found = dict.fromkeys(libraries)
    waiting = list(found)
    for library in waiting:
        new = [one for one in library._linking_libraries if one not in found] if isinstance(library, _Part) else []
        found |= dict.fromkeys(new)
        waiting += new
    return list(found)


def _link_parts(module: Any, libraries: Sequence[Any]) -> None:
    for library in libraries:
        code = library.module_alone() if isinstance(library, _Part) else library._get_module_for_linking()
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


# For functions that Python calls.
LinkingCallees = _pipeline(_Whole)
# For functions that only compiled functions call.
PartOfCallers = _pipeline(_Part)
