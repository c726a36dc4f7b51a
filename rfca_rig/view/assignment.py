"""Messages between the run's process and the view's at start-up: the assignment, and the answer READY or FAILED."""

from dataclasses import dataclass

from rfca_rig.clock import WallClock
from rfca_rig.view.run_facts import RunFacts

MODULE = "rfca_rig.view.process"
READY, FAILED = "ready", "failed"


@dataclass(frozen=True)
class ViewAssignment:
    """The run to show, and where to serve it; port 0 is any free port.

    `clock` is that of the run's queue. Both processes read the same monotonic clock of the machine, so its times can be compared.
    """

    facts: RunFacts
    queue_name: str
    clock: WallClock
    port: int
    token: str
