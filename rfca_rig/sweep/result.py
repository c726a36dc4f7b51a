"""Result of a whole sweep as one table, and its files sweep.h5 and sweep.csv.

A case is a row of outputs, or the reason why there is none.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput, RigError
from rfca_rig.escaping import csv_line
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.hdf5_file import new_hdf5_file, open_plain, run_to_completion
from rfca_rig.sweep.outputs import CaseResults, OutputMissing
from rfca_rig.sweep.plan import FORMAT, SweepPlan, as_text, digest
from rfca_rig.sweep.quantities import find_quantity

Floats = NDArray[np.float64]

# Remarks have a fixed width in the shards' files.
LONGEST_REMARK = 200
INTERNAL_ERROR = "mistake in rfca-rig"
Strings = NDArray[np.bytes_]

H5 = "sweep.h5"
CSV = "sweep.csv"
CASE = "case"
REMARK = "remark"


@dataclass(frozen=True)
class CaseRange:
    """The cases `first` to `last`, `last` excluded."""

    first: int
    last: int

    def __len__(self) -> int:
        return self.last - self.first


@dataclass(frozen=True)
class CaseRows:
    """`values` (m, outputs), NaN where there is none, and a remark for each case that gives the
    reason, else "".
    """

    values: Floats
    remarks: tuple[str, ...]


def compute(plan: SweepPlan, span: CaseRange) -> CaseRows:
    """The cases of a range, in their order. A failed case gives a row too."""
    rows = [case_row(plan, case) for case in range(span.first, span.last)]
    return CaseRows(
        np.array([values for values, _ in rows]).reshape(len(span), len(plan.outputs)),
        tuple(remark for _, remark in rows),
    )


def make_failed_rows(plan: SweepPlan, span: CaseRange, reason: str) -> CaseRows:
    """Rows of cases that could not be computed."""
    return CaseRows(np.full((len(span), len(plan.outputs)), np.nan), (_short(reason),) * len(span))


def case_row(plan: SweepPlan, case: int) -> tuple[list[float], str]:
    """The outputs of one case and its remark. They depend only on the plan and the number of the
    case.
    """
    computed = CaseResults(plan.design(case))
    values = []
    reasons = []
    for asked in plan.outputs:
        value = float("nan")
        try:
            value = asked.of(computed)
        except (OutputMissing, RigError) as error:
            # The text after the semicolon is advice for the user of a single command.
            reasons.append(str(error).split(";")[0])
        # One case must not end a sweep of a million: it is reported and counted as failed.
        except Exception as error:
            reasons.append(f"{INTERNAL_ERROR}: {type(error).__name__}: {error}")
        else:
            if not np.isfinite(value):
                reasons.append(f"{asked.header} is not finite")
                value = float("nan")
        values.append(value)
    # One cause may spoil several outputs; it is stated once.
    return values, _short("; ".join(dict.fromkeys(reasons)))


def _short(text: str) -> str:
    line = " ".join(text.split())
    if len(line) <= LONGEST_REMARK:
        return line
    return line[: LONGEST_REMARK - 2] + ".."


@dataclass(frozen=True)
class SweepResult:
    """`values` (cases, outputs) with NaN where there is none; `remarks` give the reasons, "" for
    none.
    """

    plan: SweepPlan
    values: Floats
    remarks: tuple[str, ...]

    def values_of(self, name: str) -> Floats | NDArray[np.str_]:
        """Values (cases,) of a varied quantity, as text for quantities with names."""
        column = self.plan.varied.index(name)
        return np.array([self.plan.point(case)[column] for case in range(self.plan.count)])

    def output(self, header: str) -> Floats:
        """Values (cases,) of an output."""
        return np.asarray(
            self.values[:, [asked.header for asked in self.plan.outputs].index(header)]
        )

    @property
    def failed(self) -> int:
        """Number of cases without any output."""
        return int(np.isnan(self.values).all(axis=1).sum())

    @property
    def incomplete(self) -> int:
        """Number of cases that lack some outputs, but not all."""
        return int(np.isnan(self.values).any(axis=1).sum()) - self.failed

    @property
    def mistakes(self) -> int:
        """Number of cases that hit an error of this program."""
        return sum(INTERNAL_ERROR in remark for remark in self.remarks)

    def reasons(self) -> list[tuple[str, int]]:
        """Reasons in the remarks with their counts, most frequent first; reasons that differ
        only in numbers are counted together.
        """
        counts: dict[str, int] = {}
        for remark in self.remarks:
            for reason in filter(None, remark.split("; ")):
                # Messages contain times and forces of their own case, which would make every reason
                # unique.
                key = " ".join("…" if _has_digit(word) else word for word in reason.split())
                counts[key] = counts.get(key, 0) + 1
        return sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))


def _has_digit(word: str) -> bool:
    return any(character.isdigit() for character in word)


def write_result(result: SweepResult, folder: Path) -> None:
    """Write both files; the same result gives the same bytes. Raises RigError, DiskFull.

    sweep.h5 is written last: if it exists, the sweep is complete.
    """
    write_atomically(folder / CSV, _csv(result).encode())
    with new_hdf5_file(folder / H5) as file:
        root = file.root
        plan = result.plan
        root.attrs.update({"format": FORMAT, "title": plan.title, "plan": as_text(plan)})
        columns: list[tuple[str, str, Any]] = [
            (name, find_quantity(name).words, result.values_of(name)) for name in plan.varied
        ]
        columns += [
            (asked.header, f"{asked.words}: {asked.output.equation}", result.output(asked.header))
            for asked in plan.outputs
        ]
        columns.append((REMARK, "why an output is missing", np.array(result.remarks)))
        for name, words, values in columns:
            # HDF5 stores text as bytes.
            if values.dtype.kind == "U":
                data = np.array([text.encode() for text in values])
            else:
                data = values
            dataset = root.create_dataset(name, data=data, compression=1, shuffle=True)
            dataset.attrs["long_name"] = words
        # Raises here what the disk refused while the content was written.
        file.check()
        run_to_completion(file.put_in_place())


def read_result(plan: SweepPlan, folder: Path) -> SweepResult | None:
    """Read the result of a plan from its folder; None where there is none. Raises BadInput for a
    damaged file.
    """
    path = folder / H5
    if not path.exists():
        return None
    try:
        with open_plain(path) as file:
            # The digest covers the model and the code, too.
            if digest(file.attrs["plan"]) != digest(as_text(plan)):
                raise BadInput(f"{path}: is of another sweep; give a new folder with --out")
            values = np.stack([file[asked.header][()] for asked in plan.outputs], axis=1)
            remarks = tuple(remark.decode() for remark in file[REMARK][()])
    except (OSError, KeyError, ValueError) as error:
        raise BadInput(
            f"{path}: cannot be read ({' '.join(str(error).split())}); remove it, and the "
            "same command makes it again"
        ) from None
    return SweepResult(plan, values, remarks)


def _csv(result: SweepResult) -> str:
    """One line per case, numbers with all digits, an empty cell where there is no value."""
    plan = result.plan
    lines = [csv_line([CASE, *plan.varied, *(asked.header for asked in plan.outputs), REMARK])]
    for case in range(plan.count):
        values = ["" if np.isnan(value) else repr(float(value)) for value in result.values[case]]
        lines.append(
            csv_line([case, *map(_format_value, plan.point(case)), *values, result.remarks[case]])
        )
    return "".join(lines)


def _format_value(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return repr(float(value)).removesuffix(".0")
