"""What the view's process is told by the run's, and says first: all that both of them need to know of each other."""

from dataclasses import dataclass

from rfca_rig.clock import WallClock
from rfca_rig.view.run_facts import RunFacts

MODULE = "rfca_rig.view.process"
READY, FAILED = "ready", "failed"


@dataclass(frozen=True)
class ViewAssignment:
    """Which run to show, and where; port 0 is any that is free. `clock` is that of the run's queue: both read the machine's."""

    facts: RunFacts
    queue_name: str
    clock: WallClock
    port: int
    token: str
