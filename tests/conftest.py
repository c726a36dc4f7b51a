"""What all tests share."""

import os
import signal
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

# a machine that is busy with something else is slow, which is no fault of what is tested
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

# tests that run side by side, each with threads of linear algebra that spin for the same cores, take many times as long; set before
# numpy is loaded, and for what tests start
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# the list of trusted code of whoever runs the tests stays as it is
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="rfca-rig-tests-")

# a shell that starts tests in the background has them and their children deaf to ^C, which some are about
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Folders in which at most a few tests simulate a leg or a mechanism.
WITHOUT_MODEL = {"acquisition", "campaign", "codecs", "description", "devices", "doctor", "logbook", "protocol", "structure", "vision"}


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begins the second half of the tests with those that need no compiled model.

    Of two workers, each begins with one half. In a fresh clone the first of them compiles the model for a minute and more. The second
    would compile the same meanwhile; so it comes to tests of the model when the result is on disk.
    """
    root = Path(__file__).parent

    def is_without(item: pytest.Item) -> bool:
        return Path(os.path.relpath(item.path, root)).parts[0] in WITHOUT_MODEL

    without, others = [item for item in items if is_without(item)], [item for item in items if not is_without(item)]
    half = len(items) // 2
    items[:] = [*others[:half], *without, *others[half:]]
