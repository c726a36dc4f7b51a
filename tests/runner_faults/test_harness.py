"""The harness sees what it is there to see: with the stop path broken, the runs that pass
otherwise do not.
"""

from dataclasses import replace
from pathlib import Path

import can
import pytest

from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.engine import stopping
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.limit_monitor import LimitMonitor
from tests.runner_faults.breakable import BreakableKeeper
from tests.runner_faults.causes import CAUSES
from tests.runner_faults.outcome import Outcome, caused
from tests.runner_faults.rig import FaultyRig


def outcome_of(name: str, folder: Path) -> Outcome:
    return caused(CAUSES[name], folder / "run")


def test_a_stop_path_that_does_not_tell_the_drive_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stopping, "disable_motor", lambda *_: None)
    assert not outcome_of("over-force", tmp_path).is_safe


def test_a_command_after_the_stop_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    let_go = stopping.disable_motor

    def and_yet_it_moves(motor, clock):
        let_go(motor, clock)
        motor.command_speed(1.0)

    monkeypatch.setattr(stopping, "disable_motor", and_yet_it_moves)
    outcome = outcome_of("over-force", tmp_path)
    assert outcome.motion_frames == 1
    assert not outcome.is_safe


def test_a_motor_that_is_energised_again_after_the_run_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    switch_off = stopping.stop

    def and_on_again(bench: Bench):
        standstill = switch_off(bench)
        bench.motor.enable()
        return standstill

    monkeypatch.setattr("rfca_rig.engine.run.stop", and_on_again)
    outcome = outcome_of("over-force", tmp_path)
    assert outcome.energised_s > 0.05
    assert not outcome.is_safe


def test_a_stage_that_was_acknowledged_and_is_not_there_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        BreakableKeeper, "acknowledged", property(lambda self: self.keeper.acknowledged + 1)
    )
    assert outcome_of("over-force", tmp_path).lost == 1


def test_limits_that_are_not_looked_at_are_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LimitMonitor, "reports", lambda *_: None)
    assert outcome_of("over-force", tmp_path).ended != "L-01"


def test_a_watchdog_that_something_else_than_the_loop_feeds_is_seen(tmp_path: Path) -> None:
    """As a helper thread would, while the loop stands."""
    cause = CAUSES["stopped-for-a-while"]

    def stand_but_feed(rig: FaultyRig) -> None:
        identifier, data = cansimple.set_input_vel(0, 5.0)
        frame = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        rig.engine_clock.meanwhile = lambda: rig.observer.send(frame)
        cause.begin(rig)

    assert caused(cause, tmp_path / "starved").stop.torque_ms <= cause.within_ms
    assert (
        caused(replace(cause, begin=stand_but_feed), tmp_path / "fed").stop.torque_ms
        > cause.within_ms
    )
