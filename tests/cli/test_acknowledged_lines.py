"""A stage is announced when it is on disk, and a disk that is silent is reported and stops the
run.
"""

from dataclasses import dataclass, field

from rfca_rig.cli.finalize_run import SILENT_S, STOP_S, AcknowledgedLines
from rfca_rig.clock import TwinClock
from rfca_rig.engine.interfaces import StopLevel, StopRequest


@dataclass
class Disk:
    """The recorder's and the keeper's counts."""

    ended: int = 0
    acknowledged: int = 0


@dataclass
class Printed:
    disk: Disk = field(default_factory=Disk)
    stop_request: StopRequest = field(default_factory=StopRequest)
    clock: TwinClock = field(default_factory=TwinClock)
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.held = AcknowledgedLines(
            self.lines.append, self.disk, self.disk, self.stop_request, self.clock
        )

    def end_stage(self, after_s: float = 1.0) -> None:
        self.clock.wait_until(self.clock.now_s() + after_s)
        self.disk.ended += 1
        self.held.hold(f"stage {self.disk.ended}")
        self.held.release()


def test_a_line_waits_for_its_stage():
    printed = Printed()
    printed.end_stage()
    printed.end_stage()
    assert printed.lines == []
    printed.disk.acknowledged = 1
    printed.held.release()
    assert printed.lines == ["stage 1"]
    printed.disk.acknowledged = 2
    printed.end_stage()
    assert printed.lines == ["stage 1", "stage 2"]
    printed.disk.acknowledged = 3
    printed.held.close()
    assert printed.lines[2:] == ["stage 3"]
    assert printed.stop_request.level is StopLevel.GO_ON


def test_a_silent_disk_is_reported_once_and_stops_the_run_at_a_safe_point():
    printed = Printed()
    printed.end_stage()
    printed.end_stage(SILENT_S + 0.5)
    printed.end_stage(0.5)
    assert printed.lines == ["the disk is silent: 2 stages done, not on disk since 2 s"]
    assert printed.stop_request.level is StopLevel.GO_ON
    printed.end_stage(STOP_S)
    assert printed.stop_request.level is StopLevel.SAFE_POINT
    assert "acknowledged nothing for 13 s" in printed.stop_request.why
    printed.disk.acknowledged = 1
    printed.held.close()
    assert printed.lines[1:] == [
        "stage 1",
        "3 stages were done and are not on disk: the recorder failed",
    ]


def test_a_disk_that_answers_again_is_watched_anew():
    printed = Printed()
    printed.end_stage()
    printed.clock.wait_until(printed.clock.now_s() + 3.0)
    printed.held.release()
    printed.disk.acknowledged = 1
    printed.held.release()
    printed.end_stage()
    printed.clock.wait_until(printed.clock.now_s() + 3.0)
    printed.held.release()
    assert [line[:18] for line in printed.lines] == [
        "the disk is silent",
        "stage 1",
        "the disk is silent",
    ]
