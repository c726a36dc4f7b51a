"""Evaluates the timing of a 2 ms loop on this computer, like the one that feeds the drive's watchdog."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "clock"
# Limits in s for the 99th percentile and the maximum of the loop period: two and ten nominal periods.
P99_LIMIT_S = 4e-3
WORST_LIMIT_S = 20e-3
# Resolution of the clock in s from which a 2 ms loop cannot be timed.
COARSE_S = 0.5e-3
COARSE_FIX = (
    "take the clock that counts the processor's cycles, until the next start of this computer:",
    "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource",
)


@dataclass(frozen=True)
class LoopSeen:
    """Observed loop over one second: nominal period, 99th percentile and maximum of the period, and the resolution of the clock."""

    period_s: float
    p99_s: float
    worst_s: float
    step_s: float = 1e-9


def judge_clock(seen: LoopSeen, watchdog_s: float | None) -> Finding:
    """Finding on the loop timing. `watchdog_s` is the drive's timeout; None without a real drive."""
    summary = f"loop of {1e3 * seen.period_s:g} ms: worst gap {1e3 * seen.worst_s:.1f} ms, 99 % below {1e3 * seen.p99_s:.1f} ms"
    if seen.step_s > COARSE_S:
        return red(SUBJECT, f"{summary}; the clock goes in steps of {1e3 * seen.step_s:.1f} ms", *COARSE_FIX)
    summary = f"{summary}; steps of {1e6 * seen.step_s:.2g} us"
    fix = "close other programs, and keep the processor awake:"
    command = "sudo cpupower frequency-set -g performance"
    # Half the timeout: a run lasts longer than this one second, so worse gaps must be expected.
    if watchdog_s is not None and seen.worst_s > watchdog_s / 2:
        return red(SUBJECT, f"{summary}; the drive's watchdog ends a run after {1e3 * watchdog_s:g} ms", fix, command)
    if seen.worst_s > WORST_LIMIT_S or seen.p99_s > P99_LIMIT_S:
        return yellow(SUBJECT, summary, fix, command)
    return green(SUBJECT, summary)
