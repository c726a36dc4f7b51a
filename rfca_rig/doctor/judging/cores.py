"""Evaluates the number of processor cores: a run needs one for the control loop, one for its other processes."""

from rfca_rig.doctor.finding import Finding, green, yellow

SUBJECT = "processor"
ENOUGH = 2


def judge_cores(cores: int) -> Finding:
    """Finding on the number of cores that this process may use."""
    if cores < ENOUGH:
        fix = "give this computer, or its container, a second core; what is allowed now:"
        return yellow(SUBJECT, "1 core, which the control loop shares with the writer of the recording", fix, "nproc --all; nproc")
    return green(SUBJECT, f"{cores} cores")
