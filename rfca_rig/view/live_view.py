"""The live view as a run command uses it: started before anything moves, fed during the run, left open at the end."""

from collections.abc import Callable
from importlib.util import find_spec

from rfca_rig import subprocesses
from rfca_rig.clock import WallClock
from rfca_rig.engine.interfaces import StopRequest
from rfca_rig.errors import BadInput, RigError
from rfca_rig.protocol.plan import Plan
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.view.run_facts import MODULE, READY, RunFacts, ViewAssignment, new_token
from rfca_rig.view.run_queue import RunQueue, Vitals

HOST = "127.0.0.1"
# 6 s of a sensor at 15 kHz.
QUEUE_BYTES = 4 << 20
STARTED_WITHIN_S = 30.0
NEEDED = ("starlette", "uvicorn", "websockets")


def url_of(port: int, token: str) -> str:
    """Address of the page for the operator. A browser keeps the part behind # to itself: no request, Referer or log has it."""
    return f"http://{HOST}:{port}/#token={token}"


def check_view_is_installed() -> None:
    """Raises BadInput, with the command to install it, where the optional dependency of the view is missing."""
    # find_spec looks for the packages without importing them: an import takes long, and this process does not need them.
    if any(find_spec(name) is None for name in NEEDED):
        raise BadInput('the view is an extra that is not installed; type pip install "rfca-rig[view]"')


def check_live_view() -> None:
    """The same for the live view of a run, which not every operating system supports."""
    check_view_is_installed()
    if not subprocesses.can_be_started():
        raise BadInput("a run cannot be viewed live on this system; look at its recording afterwards, with rfca-rig view RUN")


class LiveView:
    """Live view of one run. `run_queue` is the observer for its supervision, `url` the address for the operator.

    Close it when the motor is off. A view that ends by itself does not disturb the run; `is_alive` shows it.
    """

    def __init__(
        self, facts: RunFacts, plan: Plan, stop_request: StopRequest, vitals: Vitals, announce: Callable[[str], None], port: int
    ) -> None:
        """Starts the view's process; returns when the page can be opened.

        Parameters
        ----------
        facts
            What is known of the run before it begins.
        plan
            The plan of the run.
        stop_request
            Receives the stop that the operator requests on the page.
        vitals
            Returns the state of the sensor's stream, and the bytes that the recorder is behind.
        announce
            Called with a line of text when the page requests a stop.
        port
            TCP port; 0 for any free one.

        Raises
        ------
        BadInput
            For a port that is in use.
        RigError
            Where the view cannot be started.
        """
        clock, token = WallClock(), new_token()
        self._queue = BlockQueue.create(QUEUE_BYTES)
        self.run_queue = RunQueue(self._queue, plan.stages, stop_request, clock, vitals, announce)
        try:
            self._process, self._child = subprocesses.spawn(MODULE, ViewAssignment(facts, self._queue.name, clock, port, token))
        except OSError as error:
            self._queue.remove()
            raise RigError(f"the view cannot be started: {error}") from error
        self.url = url_of(self._receive_port(), token)

    def _receive_port(self) -> int:
        try:
            what, answer = self._child.recv() if self._child.poll(STARTED_WITHIN_S) else ("", f"no word within {STARTED_WITHIN_S:g} s")
        # The socket closes when the child ends before it has answered.
        except (EOFError, OSError):
            what, answer = "", "it ended by itself"
        if what == READY:
            return int(answer)
        self._process.kill()
        self.close()
        raise BadInput(answer) if what else RigError(f"the view: {answer}")

    @property
    def process_id(self) -> int:
        """Process id of the view, for measuring its cost."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def close(self) -> None:
        """The run is over. The view keeps what it has received, and stays for as long as a page is open."""
        if not self._child.closed:
            self._child.close()
            self._queue.remove()
