"""Where compiled code of the model is kept for the next process."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red

SUBJECT = "compiled code"


@dataclass(frozen=True)
class CacheSeen:
    """`error` is why the folder, or the one that it would be made in, cannot be written; None where it can."""

    folder: str
    is_warm: bool
    error: str | None = None


def judge_compiled_cache(seen: CacheSeen) -> Finding:
    if seen.error is not None:
        fix = "name a folder of your own, in this terminal and in ~/.profile:"
        return red(SUBJECT, f"{seen.folder} cannot be written: {seen.error}", fix, "export NUMBA_CACHE_DIR=$HOME/rfca-rig-compiled")
    return green(SUBJECT, f"{seen.folder}{'' if seen.is_warm else ', still empty: the first run takes ten seconds more'}")
