"""Checks of this computer, independent of the devices: clock, cores, disk, packages and compiled
code.

`look_at` functions probe, `judge` functions evaluate what was seen.
"""

import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
from packaging.requirements import Requirement

from rfca_rig import __version__
from rfca_rig.clock import Clock
from rfca_rig.devices.checks import Finding, green, red, yellow
from rfca_rig.model.kernel.compiled import CACHE_FOLDER, count_compiled

CLOCK_SUBJECT = "clock"
# Limits in s for the 99th percentile and the maximum of the loop period: two and ten nominal
# periods.
P99_LIMIT_S = 4e-3
WORST_LIMIT_S = 20e-3
# Resolution of the clock in s from which a 2 ms loop cannot be timed.
COARSE_S = 0.5e-3
COARSE_FIX = (
    "take the clock that counts the processor's cycles, until the next start of this computer:",
    "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource",
)

COMPILED_CACHE_SUBJECT = "compiled code"
COMPILES = "rfca-rig predict --height 215 --speed 2.433"

DISK_SUBJECT = "disk for runs"
LEAST_FREE_BYTES = 200_000_000
GOOD_FREE_BYTES = 2_000_000_000
# A sensor at 15 kHz produces half of this.
LEAST_BYTES_S = 1_000_000
GOOD_BYTES_S = 10_000_000

PACKAGES_SUBJECT = "python packages"
EXTRAS = "extras"

# Period of the control loop, and duration of the timing test, in s.
PERIOD_S = 2e-3
LOOP_S = 1.0
BLOCK = bytes(1 << 20)
BLOCKS = 16
# Readings of the clock, to find its resolution.
CLOCK_READINGS = 10_000
# Extras that only the tests of the package need.
FOR_TESTS = ("dev", "third-party-clients", "strangers")

CORES_SUBJECT = "processor"
MIN_CORES = 2


@dataclass(frozen=True)
class LoopSeen:
    """Observed loop over one second: nominal period, 99th percentile and maximum of the period,
    and the resolution of the clock.
    """

    period_s: float
    p99_s: float
    worst_s: float
    step_s: float = 1e-9


def judge_clock(seen: LoopSeen, watchdog_s: float | None) -> Finding:
    """Finding on the loop timing. `watchdog_s` is the drive's timeout; None without a real
    drive.
    """
    summary = (
        f"loop of {1e3 * seen.period_s:g} ms: worst gap {1e3 * seen.worst_s:.1f} ms, 99 % "
        f"below {1e3 * seen.p99_s:.1f} ms"
    )
    if seen.step_s > COARSE_S:
        return red(
            CLOCK_SUBJECT,
            f"{summary}; the clock goes in steps of {1e3 * seen.step_s:.1f} ms",
            *COARSE_FIX,
        )
    summary = f"{summary}; steps of {1e6 * seen.step_s:.2g} us"
    fix = "close other programs, and keep the processor awake:"
    command = "sudo cpupower frequency-set -g performance"
    # Half the timeout: a run lasts longer than this one second, so worse gaps must be expected.
    if watchdog_s is not None and seen.worst_s > watchdog_s / 2:
        return red(
            CLOCK_SUBJECT,
            f"{summary}; the drive's watchdog ends a run after {1e3 * watchdog_s:g} ms",
            fix,
            command,
        )
    if seen.worst_s > WORST_LIMIT_S or seen.p99_s > P99_LIMIT_S:
        return yellow(CLOCK_SUBJECT, summary, fix, command)
    return green(CLOCK_SUBJECT, summary)


@dataclass(frozen=True)
class CacheSeen:
    """Observed cache. `error` is why the folder, or its future parent, cannot be written; None if
    it can.

    `functions` is the number of functions that need not be compiled again.
    """

    folder: str
    functions: int
    error: str | None = None


def judge_compiled_cache(seen: CacheSeen) -> Finding:
    if seen.error is not None:
        fix = "name a folder of your own, in this terminal and in ~/.profile:"
        return red(
            COMPILED_CACHE_SUBJECT,
            f"{seen.folder} cannot be written: {seen.error}",
            fix,
            "export NUMBA_CACHE_DIR=$HOME/rfca-rig-compiled",
        )
    if not seen.functions:
        fix = "let it be compiled before you need it, in ten seconds to a minute:"
        return yellow(
            COMPILED_CACHE_SUBJECT,
            f"none in {seen.folder} yet: the first use of the model waits for it",
            fix,
            COMPILES,
        )
    return green(COMPILED_CACHE_SUBJECT, f"{seen.functions} functions in {seen.folder}")


@dataclass(frozen=True)
class DiskSeen:
    """Observed folder. `error` is why nothing could be written, None if it could."""

    folder: str
    free_bytes: int = 0
    bytes_per_s: float = 0.0
    error: str | None = None


def judge_disk(seen: DiskSeen) -> Finding:
    if seen.error is not None:
        return red(
            DISK_SUBJECT,
            f"{seen.folder} cannot be written: {seen.error}",
            "choose another folder with --runs, or make it yours:",
            f"sudo chown -R $USER {seen.folder}",
        )
    summary = (
        f"{seen.folder}: {seen.free_bytes / 1e9:.1f} GB free, writes "
        f"{seen.bytes_per_s / 1e6:.0f} MB/s"
    )
    if seen.free_bytes < GOOD_FREE_BYTES:
        finding = red if seen.free_bytes < LEAST_FREE_BYTES else yellow
        return finding(
            DISK_SUBJECT,
            summary,
            "make room, or choose another disk with --runs; the largest folders:",
            f"du -sh {seen.folder}/* | sort -h",
        )
    if seen.bytes_per_s < GOOD_BYTES_S:
        finding = red if seen.bytes_per_s < LEAST_BYTES_S else yellow
        return finding(
            DISK_SUBJECT,
            summary,
            "choose a local disk with --runs, not a network or USB one; the disks there are:",
            "df -h .",
        )
    return green(DISK_SUBJECT, summary)


@dataclass(frozen=True)
class PackageSeen:
    """Observed package. `wanted` is the pip requirement, `version` None if not installed, `fits`
    whether it satisfies it.
    """

    name: str
    wanted: str
    version: str | None
    fits: bool


@dataclass(frozen=True)
class ExtraSeen:
    """Observed packages of one extra (optional feature)."""

    name: str
    packages: tuple[PackageSeen, ...]


def judge_extras(seen: tuple[ExtraSeen, ...]) -> Finding:
    """Finding on the extras. They are optional, but an installed package must have a suitable
    version.
    """
    complete = []
    missing = []
    for extra in seen:
        if all(package.fits for package in extra.packages):
            versions = ", ".join(f"{package.name} {package.version}" for package in extra.packages)
            complete.append(f"{extra.name}: {versions}")
        else:
            missing.append(extra.name)
    old = [
        package
        for extra in seen
        for package in extra.packages
        if package.version is not None and not package.fits
    ]
    summary = "; ".join(complete) or "none installed"
    if missing:
        summary += f"; not installed: {', '.join(missing)}"
    if old:
        outdated = ", ".join(f"{package.name} {package.version}" for package in old)
        return yellow(
            EXTRAS,
            f"{summary}; too old: {outdated}",
            "install what fits:",
            "pip install " + " ".join(f'"{package.wanted}"' for package in old),
        )
    return green(EXTRAS, summary)


def judge_packages(seen: tuple[PackageSeen, ...], python: str, own_version: str) -> Finding:
    bad = [package for package in seen if not package.fits]
    if bad:
        problems = ", ".join(
            f"{package.name} {'is missing' if package.version is None else package.version}"
            for package in bad
        )
        return red(
            PACKAGES_SUBJECT,
            f"{problems}",
            "install what fits:",
            "pip install " + " ".join(f'"{package.wanted}"' for package in bad),
        )
    versions = ", ".join(f"{package.name} {package.version}" for package in seen)
    return green(PACKAGES_SUBJECT, f"python {python}, rfca-rig {own_version}, {versions}")


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
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
            return CacheSeen(str(folder), count_compiled(folder))
    except OSError as error:
        return CacheSeen(str(folder), 0, error.strerror or str(error))


def _nearest(folder: Path) -> Path:
    """The folder, or its nearest existing parent."""
    return next(path for path in (folder, *folder.absolute().parents) if path.exists())


def look_at_packages() -> tuple[PackageSeen, ...]:
    """Requirements of the package, without its extras."""
    requirements = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    return tuple(
        _package(requirement)
        for requirement in requirements
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""})
    )


def look_at_extras() -> tuple[ExtraSeen, ...]:
    """Extras for users, without those that only the tests need."""
    requirements = [Requirement(line) for line in metadata.requires("rfca-rig") or ()]
    names = [
        name
        for name in metadata.metadata("rfca-rig").get_all("Provides-Extra") or ()
        if name not in FOR_TESTS
    ]
    extras = []
    for name in names:
        packages = tuple(
            _package(requirement) for requirement in requirements if _is_of(requirement, name)
        )
        extras.append(ExtraSeen(name, packages))
    return tuple(extras)


def _is_of(requirement: Requirement, extra: str) -> bool:
    return (
        requirement.marker is not None
        and requirement.marker.evaluate({"extra": extra})
        and not requirement.marker.evaluate({"extra": ""})
    )


def _package(requirement: Requirement) -> PackageSeen:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return PackageSeen(requirement.name, str(requirement), None, False)
    return PackageSeen(
        requirement.name,
        str(requirement),
        version,
        requirement.specifier.contains(version, prereleases=True),
    )


def judge_cores(cores: int) -> Finding:
    """Finding on the number of cores that this process may use."""
    if cores < MIN_CORES:
        fix = "give this computer, or its container, a second core; what is allowed now:"
        return yellow(
            CORES_SUBJECT,
            "1 core, which the control loop shares with the writer of the recording",
            fix,
            "nproc --all; nproc",
        )
    return green(CORES_SUBJECT, f"{cores} cores")


def check_computer(runs: Path, clock: Clock, watchdog_s: float | None) -> Iterator[Finding]:
    """Yields all findings on this computer. `watchdog_s` is the drive's timeout, None without a
    real drive.
    """
    yield judge_clock(look_at_clock(clock), watchdog_s)
    yield judge_disk(look_at_disk(runs, clock))
    yield judge_cores(cores())
    yield judge_packages(look_at_packages(), platform.python_version(), __version__)
    yield judge_extras(look_at_extras())
    yield judge_compiled_cache(look_at_compiled_cache())
