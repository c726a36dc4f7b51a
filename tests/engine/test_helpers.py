"""A helper process that ends takes the torque away at the next tick, whatever the stage does
with it.
"""

import pytest

from rfca_rig import subprocesses
from rfca_rig.clock import TwinClock
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import RigError
from rfca_rig.protocol.experiments import StaticStages, static_plan
from rfca_rig.subprocesses import Helper, HelperWatch
from tests.engine.obedient import Motor, Nowhere, Sensor
from tests.engine.test_same_stages import RIG, SETTLE


@pytest.fixture
def helper():
    process, connection = subprocesses.start("tests.engine.helper")
    yield process, connection
    process.kill()
    process.wait()
    connection.close()


class KillingMotor(Motor):
    """Kills the helper while it commands, after so many commands; counts those that follow."""

    def __init__(self, clock: TwinClock, helper: Helper, after: int) -> None:
        super().__init__(clock)
        self._process, self._connection = helper
        self._left = after
        self.commands_after_kill = 0
        self.is_off = False

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        super().command_angle(angle_rad, speed_rad_s)
        self._left -= 1
        self.commands_after_kill += self._left < 0
        if self._left == 0:
            self._process.kill()
            # Dead before the tick ends: how long the system takes is not asked here.
            self._process.wait()

    def disable(self) -> None:
        super().disable()
        self.is_off = True


# In the move to the start, in the rest, while the shaft is held and nothing is recorded, and while
# it is recorded.
@pytest.mark.parametrize("after", [10, 80, 150, 200])
def test_no_command_follows_the_end_of_a_helper(helper: Helper, after: int) -> None:
    clock = TwinClock()
    helpers = HelperWatch()
    helpers.add(helper[1], "the helper has ended by itself")
    motor = KillingMotor(clock, helper, after)
    plan = static_plan(StaticStages("s", (0.215,), ((1.0, "loading"),), 0.4, SETTLE, 0.3), RIG)
    with pytest.raises(RigError, match="the helper has ended by itself"):
        run_plan(
            plan,
            Bench(motor, Sensor(clock), motor, clock, is_real=False),
            Nowhere(),
            lambda _: None,
            Supervision(helpers=helpers),
        )
    assert motor.commands_after_kill == 0
    assert motor.is_off


def test_a_helper_that_lives_and_talks_is_no_reason_to_stop(helper: Helper) -> None:
    process, connection = helper
    helpers = HelperWatch()
    helpers.add(connection, "ended")
    connection.send("say something")
    assert connection.poll(30.0)
    helpers.check()
    assert process.poll() is None
    assert connection.recv() == "something"
