"""A guardian before the whole twin rig, as `rfca-rig twin serve` serves it to strangers."""

import signal

import pytest

from tests.guardian.driven import driving, let_go
from tests.guardian.rigs import served_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    with served_rig(tmp_path_factory.mktemp("rig"), "mit") as served:
        yield served


@pytest.mark.realtime
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_program_that_stops_commanding_in_mid_motion_leaves_no_torque(rig, how):
    """How soon is not asked here: the server carries a whole leg, and on a busy machine takes
    frames in when it comes to it.
    """
    with driving(rig) as d:
        d.program.send_signal(how)
        let_go(d, 1.5)
