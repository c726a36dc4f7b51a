"""Checks of this computer, independent of the devices."""

import platform
from collections.abc import Iterator
from pathlib import Path

from rfca_rig import __version__
from rfca_rig.clock import Clock
from rfca_rig.doctor.finding import Finding
from rfca_rig.doctor.judging.clock import judge_clock
from rfca_rig.doctor.judging.compiled_cache import judge_compiled_cache
from rfca_rig.doctor.judging.cores import judge_cores
from rfca_rig.doctor.judging.disk import judge_disk
from rfca_rig.doctor.judging.packages import judge_extras, judge_packages
from rfca_rig.doctor.looking.computer import cores, look_at_clock, look_at_compiled_cache, look_at_disk, look_at_extras, look_at_packages


def check_computer(runs: Path, clock: Clock, watchdog_s: float | None) -> Iterator[Finding]:
    """Yields all findings on this computer. `watchdog_s` is the drive's timeout, None without a real drive."""
    yield judge_clock(look_at_clock(clock), watchdog_s)
    yield judge_disk(look_at_disk(runs, clock))
    yield judge_cores(cores())
    yield judge_packages(look_at_packages(), platform.python_version(), __version__)
    yield judge_extras(look_at_extras())
    yield judge_compiled_cache(look_at_compiled_cache())
