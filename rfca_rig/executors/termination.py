"""Work on several processes that ends cleanly where the system or a batch queue ends it."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType

# Windows closes a console in another way.
SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def interrupt_on_termination() -> Iterator[None]:
    """Within the block SIGTERM and a closed terminal interrupt like ^C, so that workers, jobs and
    semaphores do not outlive this process.

    A signal that is handled or ignored already stays so: nohup's, for example, or that of a block
    around this one. Only the first signal interrupts: `timeout` sends two, and the second must
    not disturb what is cleaned up.
    """
    # Python allows signal handlers in the main thread only.
    if current_thread() is not main_thread():
        yield
        return
    handled = [number for number in SIGNALS if signal.getsignal(number) is signal.SIG_DFL]

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in handled:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in handled:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, signal.SIG_DFL)
