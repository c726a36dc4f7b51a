"""^C while compiled code is called and hands back: an exception in the caller each time, never
the end of the process.
"""

import signal
import subprocess
import sys

import numpy as np
import pytest

from rfca_rig.model.chain import (
    HELD_SHAFT,
    Tolerance,
    advance,
    allocate_samples,
    find_rest_state,
    make_chain,
)
from rfca_rig.model.statics_contact import follow_static_path
from tests.model.legs import PAPER

INTERRUPTIONS = 1000
WITHIN_S = 2e-3


def move() -> None:
    """Through all compiled code that is called from outside of it."""
    chain = make_chain(PAPER, 0.25)
    state = find_rest_state(chain, 0.1)
    samples = allocate_samples(np.array([1e-4]), 7)
    for _ in range(20):
        advance(
            chain,
            HELD_SHAFT._replace(free=True, rotor=0.01),
            state,
            (0.0, 1e-4),
            1e-4,
            Tolerance(),
            samples,
        )
    follow_static_path(PAPER, 0.25, np.radians([3.0, 4.0]))


def interrupted_often() -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    move()
    signal.signal(signal.SIGALRM, interrupt)
    for after_s in np.random.default_rng(1).uniform(1e-5, WITHIN_S, INTERRUPTIONS):
        try:
            signal.setitimer(signal.ITIMER_REAL, after_s)
            while True:
                move()
        except KeyboardInterrupt:
            pass


@pytest.mark.slow
def test_an_interrupt_at_any_moment_is_an_exception_in_the_caller():
    program = "from tests.model.test_interrupted import interrupted_often; interrupted_often()"
    ended = subprocess.run(
        (sys.executable, "-c", program), capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")
