"""Evaluates the cache of compiled model code."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "compiled code"
COMPILES = "rfca-rig predict --height 215 --speed 2.433"


@dataclass(frozen=True)
class CacheSeen:
    """Observed cache. `error` is why the folder, or its future parent, cannot be written; None if it can.

    `functions` is the number of functions that need not be compiled again.
    """

    folder: str
    functions: int
    error: str | None = None


def judge_compiled_cache(seen: CacheSeen) -> Finding:
    if seen.error is not None:
        fix = "name a folder of your own, in this terminal and in ~/.profile:"
        return red(SUBJECT, f"{seen.folder} cannot be written: {seen.error}", fix, "export NUMBA_CACHE_DIR=$HOME/rfca-rig-compiled")
    if not seen.functions:
        fix = "let it be compiled before you need it, in ten seconds to a minute:"
        return yellow(SUBJECT, f"none in {seen.folder} yet: the first use of the model waits for it", fix, COMPILES)
    return green(SUBJECT, f"{seen.functions} functions in {seen.folder}")
