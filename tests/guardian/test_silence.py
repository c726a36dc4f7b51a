"""When a guardian finds that commands stopped coming."""

import pytest

from rfca_rig.guardian.process import CommandTimeout


def armed(limit_s: float = 0.1) -> CommandTimeout:
    silence = CommandTimeout(limit_s)
    silence.arm(0.0)
    return silence


def test_nothing_passes_before_it_is_armed_and_nothing_is_too_long():
    silence = CommandTimeout(0.1)
    assert not silence.may_pass(0.0, 0.0)
    assert not silence.has_expired(1e6)
    assert silence.remaining_s(0.0) == float("inf")


def test_arming_is_where_the_first_silence_begins():
    silence = armed()
    assert not silence.has_expired(0.1)
    assert silence.has_expired(0.101)
    assert silence.remaining_s(0.03) == pytest.approx(0.07)


def test_commands_that_keep_coming_keep_it_quiet_however_late_they_are_looked_at():
    silence = armed()
    for tick in range(1000):
        assert silence.may_pass(0.01 * tick, 0.01 * tick + 0.09)
    assert not silence.has_expired(0.01 * 999 + 0.1)


def test_a_gap_is_not_mended_by_a_later_command():
    silence = armed()
    assert not silence.may_pass(0.15, 0.15)
    assert silence.has_expired(0.15)
    assert silence.silence_s(0.15) == pytest.approx(0.15)


def test_a_command_that_lay_about_for_too_long_does_not_pass():
    """It was given in time, but whoever gave it may be gone since."""
    silence = armed()
    assert not silence.may_pass(0.05, 0.2)
    assert silence.has_expired(0.2)


def test_nothing_passes_after_disarming():
    silence = armed()
    silence.disarm()
    assert not silence.may_pass(0.01, 0.01)
    assert not silence.has_expired(1e6)
