"""Runs a sweep: sends ranges of cases to an executor, stores their results on disk, and merges them
at the end.

The division into ranges depends on the speed of the cases; the content of their rows does not.
"""

import io
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput
from rfca_rig.executors.mapping import TaskExecutor, TaskFailure, map_unordered
from rfca_rig.progress import ProgressReport
from rfca_rig.recording.atomic import AppendOnlyFile, remove, translate_os_errors, write_atomically
from rfca_rig.recording.hdf5_file import open_plain
from rfca_rig.recording.run_text import lock
from rfca_rig.sweep.plan import SweepPlan, claim_folder
from rfca_rig.sweep.result import (
    LONGEST_REMARK,
    CaseRange,
    CaseRows,
    SweepResult,
    case_row,
    compute,
    make_failed_rows,
    read_result,
    write_result,
)

FOLDER = "shards"
LOCK = "lock"
# UTF-8 needs up to four bytes per character.
TEXT = f"S{4 * LONGEST_REMARK}"

# The measurement ends after this time or number of cases, whichever comes first.
MAX_PILOT_S = 1.0
MAX_PILOT_CASES = 12
# Time that one shard should take.
SHARD_S = 1.5
BYTES_PER_NUMBER = 8
# About 17 digits, a sign, a point and a comma.
CSV_BYTES_PER_NUMBER = 20

CASES = "cases"


class Shards:
    """The shards of one plan, known by its digest, in `folder`/shards."""

    def __init__(self, folder: Path, digest: str) -> None:
        self.folder = folder / FOLDER
        self._digest = digest

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Within the context no other process writes here. Raises BadInput where one already
        does.
        """
        with translate_os_errors(self.folder, "the folder cannot be made"):
            self.folder.mkdir(exist_ok=True)
        file = AppendOnlyFile(self.folder / LOCK)
        lock(file)
        try:
            yield
        finally:
            file.close()

    def write(self, span: CaseRange, rows: CaseRows) -> None:
        """Write the rows of a range; on return they are on disk. Raises RigError, DiskFull."""
        # Built in memory and written in one piece, so that a crash never leaves half a file.
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            file.attrs["plan"] = self._digest
            file.create_dataset("values", data=rows.values)
            file.create_dataset(
                "remarks",
                data=np.array([remark.encode() for remark in rows.remarks], dtype=TEXT),
                compression=1,
            )
        write_atomically(self._path(span), content.getvalue())

    def spans(self) -> list[CaseRange]:
        """Ranges of all existing shards, in order."""
        names = (path.stem.split("-") for path in self.folder.glob("cases-*.h5"))
        return sorted(
            (CaseRange(int(first), int(last)) for _, first, last in names),
            key=lambda span: span.first,
        )

    def read(self, span: CaseRange) -> CaseRows:
        """Read the rows of a range. Raises BadInput where the file is damaged, or of another
        plan.
        """
        path = self._path(span)
        try:
            with open_plain(path) as file:
                digest = file.attrs["plan"]
                values = np.asarray(file["values"][()], dtype=np.float64)
                remarks = tuple(remark.decode() for remark in file["remarks"][()])
        except (OSError, KeyError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise BadInput(
                f"{path}: cannot be read ({reason}); remove it, and its cases are computed again"
            ) from None
        if digest != self._digest or len(values) != len(span) != len(remarks):
            raise BadInput(
                f"{path}: is of another sweep; remove it, and its cases are computed again"
            )
        return CaseRows(values, remarks)

    def clear(self) -> None:
        """Remove all shards, once their rows are stored in the result."""
        for path in self.folder.iterdir():
            remove(path)
        with translate_os_errors(self.folder, "cannot be removed"):
            self.folder.rmdir()

    def _path(self, span: CaseRange) -> Path:
        return self.folder / f"cases-{span.first:08d}-{span.last:08d}.h5"


def find_gaps(count: int, there: Iterable[CaseRange]) -> list[CaseRange]:
    """Ranges of the `count` cases that `there`, in order, does not cover."""
    gaps = []
    at = 0
    for span in there:
        if span.first > at:
            gaps.append(CaseRange(at, span.first))
        at = max(at, span.last)
    if at < count:
        return [*gaps, CaseRange(at, count)]
    return gaps


def split_gaps(gaps: Iterable[CaseRange], size: int) -> list[CaseRange]:
    """Divide the gaps into ranges of at most `size` cases."""
    return [
        CaseRange(first, min(first + size, gap.last))
        for gap in gaps
        for first in range(gap.first, gap.last, size)
    ]


@dataclass(frozen=True)
class Pace:
    """Seconds per case on one core."""

    seconds_per_case: float

    @property
    def cases_per_shard(self) -> int:
        """Number of cases for which a shard takes well above a second."""
        return max(1, round(SHARD_S / self.seconds_per_case))


def measure_pace(plan: SweepPlan, clock: Clock) -> Pace:
    """Pace of this process. The first case is not counted, because it loads and compiles what
    all cases need.
    """
    count = min(MAX_PILOT_CASES, plan.count)
    case_row(plan, 0)
    start_s = clock.now_s()
    done = 0
    while done < count and clock.now_s() - start_s < MAX_PILOT_S:
        # Cases are taken at the middle of equal parts: time differs along the axes.
        case_row(plan, ((2 * done + 1) * plan.count) // (2 * count))
        done += 1
    return Pace(max((clock.now_s() - start_s) / max(done, 1), 1e-6))


def estimate_bytes(plan: SweepPlan) -> int:
    """Rough size of sweep.h5 and sweep.csv together, in bytes."""
    columns = len(plan.varied) + len(plan.outputs) + 1
    return plan.count * columns * (BYTES_PER_NUMBER + CSV_BYTES_PER_NUMBER)


def run_sweep(
    plan: SweepPlan,
    folder: Path,
    executor: TaskExecutor,
    clocks: Callable[[], Clock],
    report_progress: ProgressReport,
) -> SweepResult:
    """Run the whole sweep, continuing from what `folder` already holds.

    Parameters
    ----------
    plan
        The sweep.
    folder
        Where it is stored.
    executor
        Computes the cases.
    clocks
        Makes a clock for each measurement of time.
    report_progress
        Progress callback.

    Raises
    ------
    BadInput
        Where the folder belongs to another sweep.
    RigError, DiskFull
        Where the disk refuses.

    Notes
    -----
    The files are bitwise the same however often the sweep was interrupted. Results received before
    an exception are on disk.
    """
    shards = Shards(folder, claim_folder(plan, folder))
    with shards.lock():
        # A finished sweep that stopped before its shards were removed only needs that.
        result = read_result(plan, folder)
        if result is None:
            _compute_missing(plan, shards, executor, clocks, report_progress)
            result = merge_shards(plan, shards)
            write_result(result, folder)
        shards.clear()
    return result


def _compute_missing(
    plan: SweepPlan,
    shards: Shards,
    executor: TaskExecutor,
    clocks: Callable[[], Clock],
    report_progress: ProgressReport,
) -> None:
    gaps = find_gaps(plan.count, shards.spans())
    if not gaps:
        return
    # Shards are sized by time, so that writing them costs little and an interruption loses little.
    size = measure_pace(plan, clocks()).cases_per_shard
    computed = plan.count - sum(map(len, gaps))
    report_progress(CASES, computed, plan.count)
    lost = []
    for span, rows in map_unordered(
        executor, partial(compute, plan), split_gaps(gaps, size), clocks
    ):
        if isinstance(rows, TaskFailure):
            lost.append(span)
            continue
        shards.write(span, rows)
        computed += len(span)
        report_progress(CASES, computed, plan.count)
    # A lost shard is tried again case by case, so that one case that ends its worker does not take
    # its neighbours along.
    for span, outcome in map_unordered(
        executor, partial(compute, plan), split_gaps(lost, 1), clocks
    ):
        shards.write(span, _rows(plan, span, outcome))
        computed += 1
        report_progress(CASES, computed, plan.count)


def _rows(plan: SweepPlan, span: CaseRange, outcome: CaseRows | TaskFailure) -> CaseRows:
    """Rows of one case; a case that ends its worker counts as failed."""
    if isinstance(outcome, TaskFailure):
        return make_failed_rows(plan, span, outcome.reason)
    return outcome


def merge_shards(plan: SweepPlan, shards: Shards) -> SweepResult:
    """All shards as one table, in the order of the cases. Raises BadInput for a damaged shard,
    or for cases that are stored twice.
    """
    spans = shards.spans()
    if sum(map(len, spans)) != plan.count:
        raise BadInput(
            f"{shards.folder}: holds some cases twice; remove the folder, and the same "
            "command computes them again"
        )
    rows = [shards.read(span) for span in spans]
    return SweepResult(
        plan,
        np.concatenate([case_rows.values for case_rows in rows]),
        tuple(remark for case_rows in rows for remark in case_rows.remarks),
    )
