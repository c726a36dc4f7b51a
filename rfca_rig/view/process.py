"""The process that serves the live view of a run. The control loop never waits for it and does not need it.

It outlives the run for as long as a page is open, so that the operator sees how the run ended. It stays a while longer for a page that is
opened late or loaded again.
"""

import asyncio
import os
import signal
import socket
import sys
import threading
from multiprocessing.connection import Connection

from rfca_rig.clock import WallClock
from rfca_rig.errors import RigError
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.live_source import LiveRun, LiveSource
from rfca_rig.view.run_facts import FAILED, READY, ViewAssignment
from rfca_rig.view.server import DEBUG_VARIABLE, Pages, listen_on, port_of, serve

# Lower priority than the control loop's process.
NICE = 5
# After the run: how long the view waits for a page, and how long it lasts at most, so that a forgotten page keeps no process for ever.
LINGERS_S = 60.0
LONGEST_S = 12 * 3600.0


def show(parent: Connection) -> None:
    """Receives its assignment from the parent, answers (READY, port) or (FAILED, why), and serves the run until a while after its end."""
    # ^C in the terminal is for the run, which may need its view to the end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _lower_priority()
    assignment: ViewAssignment = parent.recv()
    try:
        listening = listen_on(assignment.port)
        queue = BlockQueue.attach(assignment.queue_name)
    except RigError as error:
        parent.send((FAILED, str(error)))
        return
    parent.send((READY, port_of(listening)))
    legs = Legs(assignment.facts.nominal)
    # Shapes take seconds to compute; until then the page shows a straight leg.
    threading.Thread(target=legs.prepare, args=(assignment.facts.scenes,), daemon=True).start()
    run = LiveRun(LiveSource(assignment.facts, queue, assignment.clock, legs))
    try:
        asyncio.run(_serve(run, assignment, parent, listening))
    finally:
        queue.close()


def _lower_priority() -> None:
    """Lowers the priority below the control loop's, and sends output to the null device, because the run's terminal may be gone.

    Must come first: Python's tracker of shared memory is a process of its own, which keeps the streams that it inherits.
    """
    os.nice(NICE)
    if os.environ.get(DEBUG_VARIABLE):
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.dup2(nowhere, stream.fileno())


async def _serve(run: LiveRun, assignment: ViewAssignment, parent: Connection, listening: socket.socket) -> None:
    patience = LingerPolicy(assignment.clock)
    loop = asyncio.get_running_loop()

    def on_parent_exit() -> None:
        loop.remove_reader(parent.fileno())
        run.on_run_exit()
        patience.run_is_over()

    def beat(pages: Pages) -> bool:
        run.beat()
        return patience.goes_on(pages.open)

    # The parent's socket becomes readable when the parent closes it or dies: no polling is needed.
    loop.add_reader(parent.fileno(), on_parent_exit)
    await serve(run, assignment.token, listening, asyncio.Event(), beat)


class LingerPolicy:
    """Decides how long a view stays after its run."""

    def __init__(self, clock: WallClock) -> None:
        self._clock = clock
        self._over_s: float | None = None
        self._last_seen_s = clock.now_s()

    def run_is_over(self) -> None:
        self._over_s = self._last_seen_s = self._clock.now_s()

    def goes_on(self, open_pages: int) -> bool:
        """Whether to keep serving; called at every beat."""
        if self._over_s is None:
            return True
        now_s = self._clock.now_s()
        self._last_seen_s = now_s if open_pages else self._last_seen_s
        return now_s - self._last_seen_s < LINGERS_S and now_s - self._over_s < LONGEST_S


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        show(parent)
