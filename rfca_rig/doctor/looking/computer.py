"""Probes this computer: receive buffer, clock, disk, packages, cache of compiled code."""

import os
import shutil
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np
from packaging.requirements import Requirement

from rfca_rig.clock import Clock
from rfca_rig.doctor.judging.clock import LoopSeen
from rfca_rig.doctor.judging.compiled_cache import CacheSeen
from rfca_rig.doctor.judging.disk import DiskSeen
from rfca_rig.doctor.judging.packages import ExtraSeen, PackageSeen
from rfca_rig.drivers.ports import UdpDatagrams
from rfca_rig.model.compiled import CACHE_FOLDER

# Period of the control loop, and duration of the timing test, in s.
PERIOD_S = 2e-3
LOOP_S = 1.0
BLOCK = bytes(1 << 20)
BLOCKS = 16
# Readings of the clock, to find its resolution.
CLOCK_READINGS = 10_000
# Extras that only the tests of the package need.
FOR_TESTS = ("dev", "strangers")


def probe_receive_buffer() -> int:
    """Receive buffer in bytes that the system grants to a request like the driver's; nothing is sent."""
    datagrams = UdpDatagrams("127.0.0.1")
    datagrams.close()
    return datagrams.receive_buffer_bytes


def look_at_clock(clock: Clock) -> LoopSeen:
    """Runs a 2 ms loop for one second and measures its periods."""
    ticks_s = [clock.now_s()]
    for number in range(1, round(LOOP_S / PERIOD_S)):
        clock.wait_until(ticks_s[0] + number * PERIOD_S)
        ticks_s.append(clock.now_s())
    gaps_s = np.diff(ticks_s)
    return LoopSeen(PERIOD_S, float(np.quantile(gaps_s, 0.99)), float(gaps_s.max()), _step_s(clock))


def _step_s(clock: Clock) -> float:
    """Resolution of the clock in s: the smallest nonzero difference of two readings."""
    times_s = np.array([clock.now_s() for _ in range(CLOCK_READINGS)])
    steps_s = np.diff(times_s)
    return float(steps_s[steps_s > 0.0].min(initial=times_s[-1] - times_s[0]))


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def look_at_disk(runs: Path, clock: Clock) -> DiskSeen:
    """Writes 16 MB to the disk of the runs, and deletes them again."""
    folder = _nearest(runs)
    try:
        began_s = clock.now_s()
        with tempfile.TemporaryFile(dir=folder) as file:
            for _ in range(BLOCKS):
                file.write(BLOCK)
            file.flush()
            # Without it only the page cache would be measured.
            os.fsync(file.fileno())
        took_s = max(clock.now_s() - began_s, 1e-6)
        return DiskSeen(str(runs), shutil.disk_usage(folder).free, BLOCKS * len(BLOCK) / took_s)
    except OSError as error:
        return DiskSeen(str(runs), error=error.strerror or str(error))


def look_at_compiled_cache(folder: Path = Path(CACHE_FOLDER)) -> CacheSeen:
    try:
        with tempfile.TemporaryFile(dir=_nearest(folder)):
            return CacheSeen(str(folder), sum(1 for _ in folder.rglob("*.nbi")))
    except OSError as error:
        return CacheSeen(str(folder), 0, error.strerror or str(error))


def _nearest(folder: Path) -> Path:
    """The folder, or its nearest existing parent."""
    return next(place for place in (folder, *folder.absolute().parents) if place.exists())


def look_at_packages() -> tuple[PackageSeen, ...]:
    """Requirements of the package, without its extras."""
    requirements = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    return tuple(_package(one) for one in requirements if one.marker is None or one.marker.evaluate({"extra": ""}))


def look_at_extras() -> tuple[ExtraSeen, ...]:
    """Extras for users, without those that only the tests need."""
    requirements = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    names = [name for name in metadata.metadata("rfca-rig").get_all("Provides-Extra") or () if name not in FOR_TESTS]
    return tuple(ExtraSeen(name, tuple(_package(one) for one in requirements if _is_of(one, name))) for name in names)


def _is_of(requirement: Requirement, extra: str) -> bool:
    return (
        requirement.marker is not None and requirement.marker.evaluate({"extra": extra}) and not requirement.marker.evaluate({"extra": ""})
    )


def _package(requirement: Requirement) -> PackageSeen:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return PackageSeen(requirement.name, str(requirement), None, False)
    return PackageSeen(requirement.name, str(requirement), version, requirement.specifier.contains(version, prereleases=True))
