"""How many processor cores there are for a run: one for the loop, one for the processes beside it."""

from rfca_rig.doctor.finding import Finding, green, yellow

SUBJECT = "processor"
ENOUGH = 2


def judge_cores(cores: int) -> Finding:
    """`cores` are those that this process may use."""
    if cores < ENOUGH:
        fix = "give this computer, or its container, a second core; what is allowed now:"
        return yellow(SUBJECT, "1 core, which the control loop shares with the writer of the recording", fix, "nproc --all; nproc")
    return green(SUBJECT, f"{cores} cores")
