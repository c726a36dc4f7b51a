"""The live view of a run in the browser, where it was asked for."""

from collections.abc import Iterator
from contextlib import contextmanager

from rfca_rig.bench.provenance import Outcome
from rfca_rig.cli.run_config import RunConfig, Viewing
from rfca_rig.cli.terminal import Say, echo
from rfca_rig.clock import TwinClock, WatchedTwinClock
from rfca_rig.drivers.roles import StreamHealth
from rfca_rig.engine.interfaces import NULL_OBSERVER, Bench, RunObserver, StopRequest
from rfca_rig.errors import RigError, Tripped
from rfca_rig.recording.backend import RunBackend
from rfca_rig.view.run_facts import run_facts
from rfca_rig.view.run_queue import LiveView


def parse_viewing(is_asked: bool, port: int | None, pace: float) -> Viewing | None:
    """The view that the options ask for; a port implies the view."""
    if is_asked or port is not None:
        return Viewing(port or 0, pace)
    return None


def twin_clock(config: RunConfig) -> TwinClock:
    """Real time, or a multiple of it, for a twin that is watched; otherwise a twin is as fast as
    it can be.
    """
    if config.viewing and config.viewing.pace:
        return WatchedTwinClock(config.viewing.pace)
    return TwinClock()


class ViewSession:
    """The view of a run, or none."""

    def __init__(self, config: RunConfig, bench: Bench, stop_request: StopRequest) -> None:
        """Raises BadInput for an occupied port, RigError where the view cannot be started."""
        self._bench = bench
        self._mark = config.mark
        self._keeper: RunBackend | None = None
        self._say: Say | None = None
        self._view: LiveView | None = None
        if config.viewing is not None:
            facts = run_facts(
                config.plan,
                config.mark,
                bench.sensor.scale(),
                config.nominal_source.nominal(),
                config.known_to,
            )
            self._view = LiveView(
                facts, config.plan, stop_request, self._vitals, self._tell, config.viewing.port
            )
            echo(f"{config.mark} watch the run, and stop it, at {self._view.url}", err=True)

    @property
    def observer(self) -> RunObserver:
        if self._view is None:
            return NULL_OBSERVER
        return self._view.run_queue

    def _vitals(self) -> tuple[StreamHealth, int]:
        backlog_bytes = 0
        # The view begins before the recorder does.
        if self._keeper is not None:
            backlog_bytes = self._keeper.backlog_bytes
        return self._bench.sensor.health(), backlog_bytes

    def _tell(self, line: str) -> None:
        if self._say is not None:
            self._say(line)

    def begin(self, keeper: RunBackend, say: Say) -> Say:
        """Connects the recorder. Lines printed through the returned function are also shown on
        the page.
        """
        self._keeper = keeper
        self._say = self._aloud(say)
        return self._say

    def _aloud(self, say: Say) -> Say:
        view = self._view
        if view is None:
            return say

        def aloud(line: str) -> None:
            say(line)
            view.run_queue.line(line)

        return aloud

    def over(self, error: RigError | None) -> None:
        """The motor is off, because of the error, or because the run is complete."""
        if self._view is None:
            return
        code = ""
        if isinstance(error, Tripped):
            code = str(error.code)
        self._view.run_queue.end(Outcome.of(error).why, code)
        # A view that failed must not fail the run; it is reported only now.
        if not self._view.is_alive:
            echo(
                (
                    f"{self._mark} the view had ended by itself, which the run did not "
                    "notice; RFCA_RIG_DEBUG=1 shows why"
                ),
                err=True,
            )

    def close(self) -> None:
        """Sends nothing any more; the page stays for as long as it is open."""
        if self._view is not None:
            self._view.close()


@contextmanager
def attach_view(
    config: RunConfig, bench: Bench, stop_request: StopRequest
) -> Iterator[ViewSession]:
    """The view for the length of the block. Raises as ViewSession does."""
    session = ViewSession(config, bench, stop_request)
    try:
        yield session
    finally:
        session.close()
