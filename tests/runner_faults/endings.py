"""What becomes of motor and recording when the run's process is told, stopped or killed; each
line has its test in `test_signals`.
"""

from dataclasses import dataclass

EASED = "slowed down within 0.2 s, then off"
CUT_SHORT = "all stages until then, the one under way cut short"


@dataclass(frozen=True)
class Ending:
    """`exit_code` as a shell sees it; `test` is the name of the test that shows it."""

    event: str
    exit_code: str
    motor: str
    recording: str
    test: str


ENDINGS = (
    Ending(
        "^C once",
        "130",
        "off at the next safe point",
        "all stages, the one under way finished",
        "test_one_key_ends_the_run_at_the_next_safe_point",
    ),
    Ending(
        "^C twice",
        "130",
        "off at once",
        CUT_SHORT,
        "test_two_keys_end_it_at_once",
    ),
    Ending(
        "SIGTERM, SIGHUP",
        "130",
        EASED,
        CUT_SHORT,
        "test_a_signal_from_outside_ends_the_run_at_once",
    ),
    Ending(
        "terminal closed",
        "130",
        EASED,
        CUT_SHORT,
        "test_a_closed_terminal_ends_it_though_nothing_can_be_said",
    ),
    Ending(
        "parent killed, on a terminal",
        "130",
        EASED,
        CUT_SHORT,
        "test_a_parent_that_is_killed_takes_the_terminal_along",
    ),
    Ending(
        "recorder killed",
        "1",
        "off within some 15 ms, when the system has closed its connection",
        "all acknowledged stages; `rfca-rig recover` for the rest",
        "test_a_recorder_that_is_killed_ends_it",
    ),
    Ending(
        "SIGSTOP, or a machine that stands",
        "3 when it goes on",
        "off by the drive's watchdog",
        CUT_SHORT,
        "test_a_drive_whose_master_dies_or_stands_lets_go",
    ),
    Ending(
        "kill -9",
        "137",
        "off by the drive's watchdog",
        "all that was handed over; kept by the recorder",
        "test_a_run_that_is_killed_keeps_what_it_had",
    ),
)
