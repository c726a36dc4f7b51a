"""Ports kept going by a thread, for clients that wait for answers."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from rfca_rig.bench.served import Port
from rfca_rig.clock import WallClock

quick_clock = WallClock()


@contextmanager
def polled(port: Port) -> Iterator[None]:
    done = Event()

    def poll() -> None:
        while not done.is_set():
            port.poll(quick_clock.now_s())
            quick_clock.wait_until(quick_clock.now_s() + 1e-3)

    thread = Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        port.close()
