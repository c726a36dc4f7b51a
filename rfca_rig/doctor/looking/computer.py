"""Looks at this computer: receive buffer, clock, disk, packages, the folder of compiled code."""

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
from rfca_rig.drivers.datagrams import UdpDatagrams
from rfca_rig.model.compiled import CACHE_FOLDER

PERIOD_S = 2e-3
LOOP_S = 1.0
BLOCK = bytes(1 << 20)
BLOCKS = 16
LOOKS = 10_000
FOR_TESTS = ("dev", "strangers")


def granted_receive_buffer() -> int:
    """Bytes that the system gives a socket which asks for what the drivers ask for; nothing is sent."""
    datagrams = UdpDatagrams("127.0.0.1")
    datagrams.close()
    return datagrams.receive_buffer_bytes


def look_at_clock(clock: Clock) -> LoopSeen:
    """Keeps a loop of 2 ms for a second."""
    ticks_s = [clock.now_s()]
    for number in range(1, round(LOOP_S / PERIOD_S)):
        clock.wait_until(ticks_s[0] + number * PERIOD_S)
        ticks_s.append(clock.now_s())
    gaps_s = np.diff(ticks_s)
    return LoopSeen(PERIOD_S, float(np.quantile(gaps_s, 0.99)), float(gaps_s.max()), _step_s(clock))


def _step_s(clock: Clock) -> float:
    """The least by which two looks at the clock differ, if they differ at all."""
    times_s = np.array([clock.now_s() for _ in range(LOOKS)])
    steps_s = np.diff(times_s)
    return float(steps_s[steps_s > 0.0].min(initial=times_s[-1] - times_s[0]))


def cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def look_at_disk(runs: Path, clock: Clock) -> DiskSeen:
    """Writes 16 MB beside where runs go, down to the disk, and takes them away again."""
    folder = _nearest(runs)
    try:
        began_s = clock.now_s()
        with tempfile.TemporaryFile(dir=folder) as file:
            for _ in range(BLOCKS):
                file.write(BLOCK)
            file.flush()
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
    """The folder, or of those that it would be made in the one that is there."""
    return next(place for place in (folder, *folder.absolute().parents) if place.exists())


def look_at_packages() -> tuple[PackageSeen, ...]:
    """What the package says it needs, without its extras."""
    wanted = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    return tuple(_package(one) for one in wanted if one.marker is None or one.marker.evaluate({"extra": ""}))


def look_at_extras() -> tuple[ExtraSeen, ...]:
    """Those for users; what only the package's own tests need is left out."""
    wanted = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    names = [name for name in metadata.metadata("rfca-rig").get_all("Provides-Extra") or () if name not in FOR_TESTS]
    return tuple(ExtraSeen(name, tuple(_package(one) for one in wanted if _is_of(one, name))) for name in names)


def _is_of(wanted: Requirement, extra: str) -> bool:
    return wanted.marker is not None and wanted.marker.evaluate({"extra": extra}) and not wanted.marker.evaluate({"extra": ""})


def _package(wanted: Requirement) -> PackageSeen:
    try:
        version = metadata.version(wanted.name)
    except metadata.PackageNotFoundError:
        return PackageSeen(wanted.name, str(wanted), None, False)
    return PackageSeen(wanted.name, str(wanted), version, wanted.specifier.contains(version, prereleases=True))
