"""This computer: judged as if it had been measured, and really looked at."""

import sys
from pathlib import Path

import pytest

from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.devices.checks import judge_receive_buffer, look_at_serial_port, probe_receive_buffer
from rfca_rig.doctor.computer import (
    CacheSeen,
    DiskSeen,
    ExtraSeen,
    LoopSeen,
    PackageSeen,
    judge_clock,
    judge_compiled_cache,
    judge_cores,
    judge_disk,
    judge_extras,
    judge_packages,
    look_at_clock,
    look_at_compiled_cache,
    look_at_disk,
    look_at_extras,
    look_at_packages,
)
from rfca_rig.doctor.ports import look_at_can_interface
from rfca_rig.twin_server.can_ports import PseudoTerminal
from tests.doctor.said import whole


@pytest.mark.parametrize(
    ("p99_ms", "worst_ms", "watchdog_s", "colour"),
    [
        (2.3, 6.0, 0.1, "green"),
        (5.0, 6.0, 0.1, "yellow"),
        (2.3, 40.0, 0.1, "yellow"),
        (2.3, 60.0, 0.1, "red"),
        (2.3, 40.0, 0.05, "red"),
        (2.3, 600.0, None, "yellow"),
    ],
)
def test_the_clock_is_judged_by_the_watchdog_that_hangs_on_it(p99_ms, worst_ms, watchdog_s, colour):
    finding = judge_clock(LoopSeen(2e-3, 1e-3 * p99_ms, 1e-3 * worst_ms), watchdog_s)
    assert finding.colour == colour
    assert f"worst gap {worst_ms:.1f} ms" in whole(finding)


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (DiskSeen("runs", 50_000_000_000, 3e8), "green", "50.0 GB free, writes 300 MB/s"),
        (DiskSeen("runs", 1_000_000_000, 3e8), "yellow", "du -sh runs/* | sort -h"),
        (DiskSeen("runs", 100_000_000, 3e8), "red", "make room"),
        (DiskSeen("runs", 50_000_000_000, 4e6), "yellow", "local disk"),
        (DiskSeen("runs", 50_000_000_000, 4e5), "red", "local disk"),
        (
            DiskSeen("runs", error="Permission denied"),
            "red",
            "runs cannot be written: Permission denied",
        ),
    ],
)
def test_a_disk_is_judged(seen, colour, says):
    finding = judge_disk(seen)
    assert finding.colour == colour
    assert says in whole(finding)


def test_a_small_receive_buffer_is_told_in_milliseconds_with_the_line_that_raises_it():
    finding = judge_receive_buffer(2 * 212_992, 4 << 20, 15_000.0)
    assert finding.colour == "yellow"
    assert "34 ms of single records" in finding.seen  # 512 datagrams of one record
    assert finding.commands == ("sudo sysctl -w net.core.rmem_max=4194304",)
    assert judge_receive_buffer(8 << 20, 4 << 20, 15_000.0).colour == "green"
    assert probe_receive_buffer() > 0


def test_packages_that_do_not_fit_are_named_as_pip_takes_them():
    good = PackageSeen("numpy", "numpy>=1.26", "2.1.0", True)
    missing = PackageSeen("h5py", "h5py>=3.10", None, False)
    old = PackageSeen("scipy", "scipy>=1.11", "1.9", False)
    finding = judge_packages((good, missing, old), "3.11", "0.1.0")
    assert finding.commands == ('pip install "h5py>=3.10" "scipy>=1.11"',)
    assert "h5py is missing, scipy 1.9" in whole(finding)
    assert judge_packages((good,), "3.11", "0.1.0").colour == "green"
    seen = {package.name: package for package in look_at_packages()}
    assert seen["numpy"].fits and seen["numpy"].version == sys.modules["numpy"].__version__
    assert "mujoco" not in seen


def test_a_coarse_clock_and_a_single_core_are_told_with_the_line_that_mends_them():
    assert judge_clock(LoopSeen(2e-3, 2.1e-3, 3e-3, 4e-3), None).colour == "red"
    assert "steps of 0.04 us" in judge_clock(LoopSeen(2e-3, 2.1e-3, 3e-3, 4e-8), None).seen
    assert (judge_cores(1).colour, bool(judge_cores(1).commands)) == ("yellow", True)
    assert judge_cores(2).seen == "2 cores"


def test_extras_are_told_apart_by_what_is_there_and_what_fits():
    good, old, missing = (
        PackageSeen(name, f"{name}>=2", version, fits)
        for name, version, fits in (
            ("dask", "2.1", True),
            ("mujoco", "1.0", False),
            ("nidaqmx", None, False),
        )
    )
    finding = judge_extras((ExtraSeen("cluster", (good,)), ExtraSeen("daq", (missing,))))
    assert (finding.colour, finding.seen) == ("green", "cluster: dask 2.1; not installed: daq")
    worn = judge_extras((ExtraSeen("crosscheck", (old,)),))
    assert (worn.colour, worn.commands) == ("yellow", ('pip install "mujoco>=2"',))
    assert "crosscheck" in {extra.name for extra in look_at_extras()}
    assert all(extra.packages for extra in look_at_extras())


def test_the_loop_that_was_asked_for_is_the_loop_that_is_measured():
    seen = look_at_clock(LateClock())
    assert (seen.period_s, seen.p99_s, seen.worst_s) == pytest.approx((2e-3, 7e-3, 32e-3), abs=1e-5)
    assert seen.step_s == pytest.approx(1e-6)


class LateClock(TwinClock):
    """Every 50th wait ends 5 ms late, one of them 30 ms. Every second reading is 1 us later than
    the one before.
    """

    def __init__(self) -> None:
        super().__init__()
        self._waits = self._readings = 0

    def now_s(self) -> float:
        self._readings += 1
        return super().now_s() + 1e-6 * (self._readings // 2)

    def wait_until(self, t_s: float) -> None:
        self._waits += 1
        if self._waits % 50:
            late_s = 0.0
        else:
            late_s = 30e-3 if self._waits == 250 else 5e-3
        super().wait_until(t_s + late_s)


def test_a_folder_that_is_not_there_yet_is_measured_where_it_would_be_made(tmp_path):
    seen = look_at_disk(tmp_path / "not" / "yet", WallClock())
    assert seen.error is None and seen.free_bytes > 0 and seen.bytes_per_s > 0
    assert list(tmp_path.iterdir()) == []
    cache = look_at_compiled_cache(tmp_path / "compiled")
    assert (cache.error, cache.functions) == (None, 0)
    finding = judge_compiled_cache(cache)
    assert finding.colour == "yellow"
    assert finding.commands == ("rfca-rig predict --height 215 --speed 2.433",)


def test_a_folder_that_cannot_be_written_is_red():
    nowhere = Path("/proc/rfca-rig")
    assert judge_disk(look_at_disk(nowhere, WallClock())).colour == "red"
    finding = judge_compiled_cache(look_at_compiled_cache(nowhere))
    assert "export NUMBA_CACHE_DIR=" in whole(finding)
    assert judge_compiled_cache(CacheSeen("there", 41)).colour == "green"


def made_interface(network: Path, name: str, kind: int, flags: str, mtu: int) -> None:
    folder = network / name
    folder.mkdir()
    for file, text in (("type", str(kind)), ("flags", flags), ("mtu", str(mtu))):
        (folder / file).write_text(f"{text}\n")


def test_what_the_kernel_says_of_interfaces_is_read(tmp_path):
    made_interface(tmp_path, "eth0", 1, "0x1003", 1500)
    made_interface(tmp_path, "can0", 280, "0x40080", 16)
    made_interface(tmp_path, "can1", 280, "0x400c1", 72)
    down, up = (look_at_can_interface(name, tmp_path) for name in ("can0", "can1"))
    assert (down.exists, down.is_can, down.is_up, down.is_fd, down.others) == (
        True,
        True,
        False,
        False,
        ("can1",),
    )
    assert (up.is_up, up.is_fd) == (True, True)
    assert not look_at_can_interface("eth0", tmp_path).is_can
    absent = look_at_can_interface("can7", tmp_path)
    assert (absent.exists, absent.others) == (False, ("can0", "can1"))


def test_a_serial_port_is_looked_at():
    line = PseudoTerminal()
    try:
        assert look_at_serial_port(line.path).may_open
    finally:
        line.close()
    assert not look_at_serial_port("/dev/there-is-none").exists
