"""What all tests share."""

import atexit
import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Generator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.every_answer import SEEN, take_contradictions, watch_entry_points

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# a machine that is busy with something else is slow, which is no fault of what is tested
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

# tests that run side by side, each with threads of linear algebra that spin for the same cores,
# take many times as long; set before numpy is loaded, and for what tests start
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# the list of trusted code of whoever runs the tests stays as it is
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="rfca-rig-tests-")


def _remove_config_home(folder: str, owner: int) -> None:
    """A forked child, which ends before the tests do, leaves the folder to its parent."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


atexit.register(_remove_config_home, os.environ["XDG_CONFIG_HOME"], os.getpid())

# a shell that starts tests in the background has them and their children deaf to ^C, which some are
# about
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before any other module of the package is imported, so that no answer of a diagnosis is missed.
watch_entry_points()

# Name under which a test's report carries the number of its answers.
ANSWERS = "answers of diagnoses"

# Folders in which at most a few tests simulate a leg or a mechanism.
WITHOUT_MODEL = {
    "acquisition",
    "campaign",
    "codecs",
    "description",
    "devices",
    "doctor",
    "logbook",
    "protocol",
    "structure",
    "vision",
}


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Leaves out of every later search for garbage what is there until the end: all imported
    modules and all tests.

    They are a million objects and more, which each search would look at; so would the searches of
    processes that tests fork.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        # As commands set it: compilation and pages make many objects that stay.
        gc.set_threshold(10_000)
        gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _each_function_compiled_by_one_worker(
    tmp_path_factory: pytest.TempPathFactory,
) -> Generator[None]:
    """A worker that needs a function which another one is compiling waits for it, and then loads it
    from the disk.

    Otherwise both would compile it. Two to three workers need the same functions in the first
    minute, at 10 to 25 s each.
    """
    numba = sys.modules.get("numba")
    if numba is None or fcntl is None or "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    # The workers' own folders stand in it.
    folder = tmp_path_factory.getbasetemp().parent
    compile_function = Dispatcher.compile

    def compile_alone(dispatcher: Any, signature: Any) -> Any:
        function = dispatcher.py_func
        # The lock within the process comes first: its threads would otherwise wait for each other
        # in a circle.
        with (
            global_compiler_lock,
            (folder / f"compiling-{function.__module__}.{function.__qualname__}"[:200]).open(
                "w"
            ) as file,
        ):
            fcntl.flock(file, fcntl.LOCK_EX)
            return compile_function(dispatcher, signature)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compile_alone)
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Fails a test where an answer that was made for it, also by a fixture, contradicts itself."""
    try:
        result = yield
    except BaseException as error:
        for contradiction in take_contradictions():
            error.add_note(contradiction)
        raise
    contradictions = take_contradictions()
    if contradictions:
        pytest.fail("\n".join(contradictions), pytrace=False)
    return result


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Hands the number of answers on to the end of all tests, which may be in another process."""
    if SEEN:
        item.user_properties.append((ANSWERS, len(SEEN)))
        SEEN.clear()


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Says how many answers of diagnoses were looked at."""
    reports = [report for reports in terminalreporter.stats.values() for report in reports]
    answers = 0
    for report in reports:
        if getattr(report, "when", "") == "teardown":
            answers += dict(report.user_properties).get(ANSWERS, 0)
    if answers:
        terminalreporter.write_line(
            f"answers of diagnoses compared with their own numbers: {answers}"
        )


# Files with slow tests of up to a minute each. At the end of all tests such a test leaves the other
# workers idle. Pictures need the README's job, so that they follow it in the same worker, which
# otherwise waits for it.
FIRST_OF_ONE = ("test_readme.py", "test_pictures.py")
FIRST_OF_OTHER = ("test_notebooks.py", "test_pendulum.py", "test_whole_diagnosis.py")


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """One worker more than cores for `-n auto`: many tests wait, for a browser, a device or a
    process, and leave their core to others.
    """
    workers = yield
    if os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS"):
        return workers
    return workers + 1


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begins the part of each worker with what should not come last, and all parts but the first
    with tests that need no compiled model.

    Each worker begins with an equal part. In a fresh clone the first of them compiles the model for
    a minute and more. The others would compile the same meanwhile; so they come to tests of the
    model when the result is on disk.
    """
    root = Path(__file__).parent

    @cache
    def is_without(file: Path) -> bool:
        return Path(os.path.relpath(file, root)).parts[0] in WITHOUT_MODEL

    def take(names: Sequence[str]) -> list[pytest.Item]:
        """The slow tests of these files, in the order of the names."""
        slow = [
            item for item in items if item.path.name in names and item.get_closest_marker("slow")
        ]
        return sorted(slow, key=lambda item: names.index(item.path.name))

    one = take(FIRST_OF_ONE)
    other = take(FIRST_OF_OTHER)
    first = {*one, *other}
    rest = [item for item in items if item not in first]
    without = [item for item in rest if is_without(item.path)]
    others = [item for item in rest if not is_without(item.path)]
    workers = max(int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "2")), 2)
    step = -(-len(without) // (workers - 1))
    begins = [one, *(without[step * number : step * (number + 1)] for number in range(workers - 1))]
    begins[1] = [*other, *begins[1]]
    ordered: list[pytest.Item] = []
    for number, begin in enumerate(begins):
        part = (len(items) - len(ordered)) // (workers - number)
        more = max(part - len(begin), 0)
        ordered += [*begin, *others[:more]]
        del others[:more]
    items[:] = [*ordered, *others]
