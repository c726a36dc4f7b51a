"""Compiled functions that only compiled functions call become part of their callers."""

import numba
import numpy as np
from numba.core import codegen

from rfca_rig.model.kernel.compiled import jit, jit_inline, jit_internal


@jit_internal
def square(x: float) -> float:
    return x * x


@jit_inline
def add_squares(x: float, y: float) -> float:
    return square(x) + square(y)


@jit_internal
def length(x: float, y: float) -> float:
    return np.sqrt(add_squares(x, y))


def far(x: float, y: float) -> float:
    return length(x, y) + square(x)


def test_a_function_is_optimised_with_all_that_it_calls_at_once(monkeypatch) -> None:
    optimised: list[str] = []
    optimise = codegen.CPUCodeLibrary._optimize_final_module

    def record(self) -> None:
        optimised.append(self.name)
        optimise(self)

    monkeypatch.setattr(codegen.CPUCodeLibrary, "_optimize_final_module", record)
    compiled = jit(far)
    # Not from an earlier process, which would have compiled nothing now.
    compiled.disable_compile(False)
    compiled._cache = type(
        "NoCache", (), {"load_overload": lambda *_: None, "save_overload": lambda *_: None}
    )()
    assert compiled(3.0, 4.0) == 5.0 + 9.0
    ours = [name for name in optimised if name in ("square", "add_squares", "length", "far")]
    assert ours == ["far"]


def test_a_function_that_knows_nothing_of_parts_may_call_them() -> None:
    # As the law of an effect does, which is compiled on its own.
    plain = numba.njit(far)
    assert plain(3.0, 4.0) == 5.0 + 9.0
    # A second caller of the same parts.
    other = numba.njit(lambda x: length(x, x))
    assert other(1.0) == np.sqrt(2.0)
