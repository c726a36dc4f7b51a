"""The live view as a run command uses it: started before anything moves, told of everything, left behind at the end."""

from collections.abc import Callable
from importlib.util import find_spec

from rfca_rig import subprocesses
from rfca_rig.clock import WallClock
from rfca_rig.engine.stop_request import StopRequest
from rfca_rig.errors import BadInput, RigError
from rfca_rig.protocol.plan import Plan
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.view.access_token import new_token
from rfca_rig.view.assignment import MODULE, READY, ViewAssignment
from rfca_rig.view.run_facts import RunFacts
from rfca_rig.view.run_queue import RunQueue, Vitals

HOST = "127.0.0.1"
QUEUE_BYTES = 4 << 20  # 6 s of a sensor at 15 kHz
STARTED_WITHIN_S = 30.0
NEEDED = ("starlette", "uvicorn", "websockets")


def url_of(port: int, token: str) -> str:
    """What the operator opens."""
    return f"http://{HOST}:{port}/?token={token}"


def check_view_is_installed() -> None:
    """Raises BadInput, saying what to install, where the view's extra is missing."""
    if any(find_spec(name) is None for name in NEEDED):
        raise BadInput('the view is an extra that is not installed; type pip install "rfca-rig[view]"')


def check_live_view() -> None:
    """The same for the view of a run that goes on, and for systems that cannot have it."""
    check_view_is_installed()
    if not subprocesses.can_be_started():
        raise BadInput("a run cannot be viewed live on this system; look at its recording afterwards, with rfca-rig view RUN")


class LiveView:
    """One run's. `run_queue` is the observer for its supervision, `url` what the operator opens. To be closed when the motor is off.

    A view that ends by itself costs the run nothing; `is_alive` tells.
    """

    def __init__(
        self, facts: RunFacts, plan: Plan, stop_request: StopRequest, vitals: Vitals, told: Callable[[str], None], port: int
    ) -> None:
        """Returns when the page can be opened; `port` 0 is any that is free. `vitals` and `told` are those of the run's queue.

        Raises BadInput for a port that is taken, RigError where the view cannot be started.
        """
        clock, token = WallClock(), new_token()
        self._queue = BlockQueue.create(QUEUE_BYTES)
        self.run_queue = RunQueue(self._queue, plan.stages, stop_request, clock, vitals, told)
        try:
            self._process, self._child = subprocesses.started(MODULE, ViewAssignment(facts, self._queue.name, clock, port, token))
        except OSError as error:
            self._queue.remove()
            raise RigError(f"the view cannot be started: {error}") from error
        self.url = url_of(self._heard_port(), token)

    def _heard_port(self) -> int:
        try:
            what, said = self._child.recv() if self._child.poll(STARTED_WITHIN_S) else ("", f"no word within {STARTED_WITHIN_S:g} s")
        except (EOFError, OSError):
            what, said = "", "it ended by itself"
        if what == READY:
            return int(said)
        self._process.kill()
        self.close()
        raise BadInput(said) if what else RigError(f"the view: {said}")

    @property
    def process_id(self) -> int:
        """Of the view, for watching its cost."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def close(self) -> None:
        """The run is over. The view goes on by itself, with all that it was told, for as long as a page is open."""
        if not self._child.closed:
            self._child.close()
            self._queue.remove()
