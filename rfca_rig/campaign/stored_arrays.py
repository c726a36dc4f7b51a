"""Columns of files that hold arrays: HDF5, also as MATLAB, pandas and NeXus write it, and MATLAB's
older files.

A column is named by the path of its array, and by what is picked of it: `log/x` of a vector,
`log/x[2]` of the third column of a matrix, `log[time]` of the field of a table of records. Arrays
whose attributes state a scale hold counts, and are read in the unit that their attributes state.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from numpy.typing import NDArray

from rfca_rig.campaign.recorded_columns import (
    ColumnList,
    ColumnRequest,
    RecordedColumns,
    find_rising,
    finite_or_none,
)
from rfca_rig.campaign.table import FEWEST_SAMPLES
from rfca_rig.errors import BadInput
from rfca_rig.recording.hdf5_file import open_plain
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

# Columns of a matrix that a draft lists: a wider one is a picture or a map.
MOST_COLUMNS = 64

# Attributes that state value = scale * count + offset: CF conventions, NWB and this program's own
# runs, NeXus.
SCALES = (("scale_factor", "add_offset"), ("conversion", "offset"), ("scaling_factor", None))
FILL_VALUES = ("_FillValue", "missing_value")
UNITS = ("units", "unit")

# Column with the number of the episode of each sample, in data sets of LeRobot.
EPISODE = "episode_index"

_PICKED = re.compile(r"(.+)\[([^\[\]]+)\]")
# Kinds of dtype: signed, unsigned, floating point.
_NUMBERS = "iuf"
_WHOLE_NUMBERS = "iu"


@dataclass(frozen=True)
class StoredArray:
    """One array of a file, which is read when it is asked for: an HDF5 dataset or an array.

    `is_invalid` (m,) are the samples that the file marks as invalid; None where it marks none.
    """

    name: str
    data: Any
    attributes: Mapping[str, Any] = field(default_factory=dict)
    is_invalid: NDArray[np.bool_] | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape, in which a matrix of one row or column is a vector."""
        shape = tuple(self.data.shape)
        if len(shape) == 2 and 1 in shape:
            return (max(shape),)
        return shape

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields of a table of records; none of other arrays."""
        return tuple(self.data.dtype.names or ())

    @property
    def unit(self) -> str:
        """The unit that its attributes state; "" without."""
        for name in UNITS:
            if name in self.attributes:
                return _as_text(self.attributes[name])
        return ""

    def read(self) -> NDArray[Any]:
        """All of it, a vector as (m,), a matrix as (m, k)."""
        return np.asarray(self.data[()]).reshape(self.shape)

    def find_scale(self) -> tuple[float, float, str] | None:
        """Scale and offset of the counts that it holds, and the attribute that states them; None
        where none does.
        """
        for scale_name, offset_name in SCALES:
            scale = _as_number(self.attributes.get(scale_name))
            offset = _as_number(self.attributes.get(offset_name or ""))
            # An offset alone may be that of anything.
            if scale is not None:
                return scale, offset or 0.0, scale_name
            if offset is not None and offset_name == "add_offset":
                return 1.0, offset, offset_name
        return None

    def convert(self, counts: NDArray[Any]) -> Floats:
        """Counts (m,) as values in the stated unit, NaN where a fill value stands."""
        values = np.asarray(counts, dtype=np.float64)
        for name in FILL_VALUES:
            fill = _as_number(self.attributes.get(name))
            if fill is not None:
                values = np.where(values == fill, np.nan, values)
        scaled = self.find_scale()
        if scaled is not None:
            scale, offset, _ = scaled
            values = scale * values + offset
        return values


def _as_number(attribute: Any) -> float | None:
    """An attribute as a number; None where it is none."""
    if attribute is None:
        return None
    values = np.asarray(attribute)
    if values.size != 1 or values.dtype.kind not in _NUMBERS:
        return None
    return float(values.ravel()[0])


def _as_text(attribute: Any) -> str:
    """An attribute as text; "" where it is none."""
    value = np.asarray(attribute).ravel()
    if value.size != 1:
        return ""
    text = value[0]
    if isinstance(text, bytes):
        return text.decode("utf-8", errors="replace")
    if isinstance(text, str):
        return text
    return ""


@dataclass(frozen=True)
class ArrayFormat:
    """A kind of file that holds arrays: its name in messages, and what opens a file for its arrays
    by name.
    """

    name: str
    open_arrays: Callable[[Path], AbstractContextManager[Mapping[str, StoredArray]]]


def read_array_columns(
    path: Path, request: ColumnRequest, array_format: ArrayFormat
) -> RecordedColumns:
    """Read the requested columns of a file that holds arrays.

    Raises
    ------
    BadInput
        Where the file cannot be read, a column is missing, holds no numbers or differs in length
        from the others, or a value is not finite.
    """
    recorded = read_arrays(path, request.with_time, array_format, request.episode)
    return replace(recorded, t_s=request.time_of(recorded.values))


def read_arrays(
    path: Path, holds: Mapping[str, str], array_format: ArrayFormat, episode: int | None = None
) -> RecordedColumns:
    """Read these columns, of which the first is the time, as it stands in the file; `holds` is
    the content of each in words. Raises BadInput as `read_array_columns` does.
    """
    values: dict[str, Floats] = {}
    units: dict[str, str] = {}
    notes: dict[str, None] = {}
    with _open(path, array_format) as arrays:
        is_used = _select_episode(path, arrays, episode)
        samples: int | None = None
        arrays_used: list[StoredArray] = []
        for name, meaning in holds.items():
            array, picked = _find_array(path, arrays, name, meaning)
            arrays_used.append(array)
            try:
                values[name] = _pick(array, picked, samples)
            except _NoColumn as fault:
                raise BadInput(
                    f"{path}: column {name}, which is to hold {meaning}: {fault}"
                ) from None
            # The time comes first, and says how many samples there are.
            if samples is None:
                samples = len(values[name])
            if array.unit and not array.fields:
                units[name] = array.unit
            for note in _describe(array, picked, samples):
                notes[note] = None
    time, *_ = holds
    _check_lengths(path, time, values)
    if len(is_used) != samples:
        is_used = np.ones(samples or 0, dtype=bool)
    is_valid = _find_valid(arrays_used, is_used)
    if not is_valid.all():
        count = np.count_nonzero(is_used & ~is_valid)
        notes[f"{count} samples that the file marks as invalid, or names, are left out"] = None
    used = {name: column[is_used & is_valid] for name, column in values.items()}
    _check_finite(path, used)
    return RecordedColumns(path, used[time], used, units=units, notes=tuple(notes))


def _check_lengths(path: Path, time: str, values: Mapping[str, Floats]) -> None:
    """Raises BadInput for a column with more or fewer samples than the time."""
    samples = len(values[time])
    for name, column in values.items():
        if len(column) != samples:
            raise BadInput(
                f"{path}: column {name} has {len(column)} samples and "
                f"{time} has {samples}; they must be as many"
            )


def _check_finite(path: Path, values: Mapping[str, Floats]) -> None:
    """Raises BadInput for a value that is no finite number."""
    for name, column in values.items():
        faulty = np.flatnonzero(~np.isfinite(column))
        if faulty.size:
            row = int(faulty[0])
            raise BadInput(
                f"{path}: column {name}: sample {row + 1} is {column[row]:g}; every "
                "sample needs a finite number"
            )


def _find_valid(arrays: Iterable[StoredArray], is_used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which samples (m,) no array marks as invalid; others than those that are used (m,) count as
    valid.
    """
    is_valid = np.ones(len(is_used), dtype=bool)
    for array in arrays:
        if array.is_invalid is not None:
            is_valid &= ~array.is_invalid
    return is_valid | ~is_used


def list_array_columns(path: Path, array_format: ArrayFormat) -> ColumnList:
    """List all columns of the file with enough samples for a recording. Raises BadInput where it
    cannot be read.
    """
    values: dict[str, Floats | None] = {}
    units: dict[str, str] = {}
    notes: list[str] = []
    with _open(path, array_format) as arrays:
        samples = _find_samples(arrays.values())
        episodes = _list_episodes(arrays)
        is_first = np.zeros(0, dtype=bool)
        if episodes:
            is_first = arrays[EPISODE].read() == episodes[0]
        for array in arrays.values():
            if len(array.shape) not in (1, 2) or max(array.shape) < FEWEST_SAMPLES:
                continue
            count = _count_columns(array, samples)
            if count > MOST_COLUMNS:
                notes.append(f"{array.name}: {count} columns, which are too many to list")
                continue
            of_array = _list_array(array, samples)
            values |= of_array
            notes += _describe(array, None, samples)
            if array.unit and not array.fields:
                units |= dict.fromkeys(of_array, array.unit)
                notes.append(f"{array.name}: the file states the unit {array.unit}")
    times = find_rising(values)
    if len(episodes) > 1:
        # The time of each episode starts at zero.
        of_first = {
            name: column[is_first]
            for name, column in values.items()
            if column is not None and len(column) == len(is_first)
        }
        times = find_rising(of_first)
        notes.append(f"episodes: {len(episodes)}, of which each recording names one")
    return ColumnList(values, times, units=units, notes=tuple(notes), episodes=episodes)


def list_array_episodes(path: Path, array_format: ArrayFormat) -> tuple[int, ...]:
    """The numbers of the episodes in a file. Raises BadInput where it cannot be read."""
    with _open(path, array_format) as arrays:
        return _list_episodes(arrays)


def _list_episodes(arrays: Mapping[str, StoredArray]) -> tuple[int, ...]:
    array = arrays.get(EPISODE)
    if array is None or len(array.shape) != 1 or array.data.dtype.kind not in _WHOLE_NUMBERS:
        return ()
    return tuple(int(number) for number in np.unique(array.read()))


def _select_episode(
    path: Path, arrays: Mapping[str, StoredArray], episode: int | None
) -> NDArray[np.bool_]:
    """Which samples (m,) belong to the requested episode; (0,) where a file knows none. Raises
    BadInput where the episode is not in the file, or none is requested of several.
    """
    episodes = _list_episodes(arrays)
    if not episodes:
        if episode is not None:
            raise BadInput(f"{path}: has no column {EPISODE}; remove episode = {episode}")
        return np.zeros(0, dtype=bool)
    if episode is None and len(episodes) > 1:
        raise BadInput(
            f"{path}: holds the episodes {episodes[0]} to {episodes[-1]}; state one in "
            f"[[recordings]], as in episode = {episodes[0]}"
        )
    if episode is not None and episode not in episodes:
        raise BadInput(f"{path}: holds no episode {episode}, but {episodes[0]} to {episodes[-1]}")
    return np.asarray(arrays[EPISODE].read() == (episodes[0] if episode is None else episode))


def _find_samples(arrays: Iterable[StoredArray]) -> int | None:
    """The length that most vectors of a file have; None where it has none."""
    lengths = Counter(array.shape[0] for array in arrays if len(array.shape) == 1)
    if not lengths:
        return None
    return lengths.most_common(1)[0][0]


def _count_columns(array: StoredArray, samples: int | None) -> int:
    """Columns of a vector or a matrix."""
    if len(array.shape) == 1:
        return 1
    if _is_transposed(array, samples):
        return array.shape[0]
    return array.shape[1]


@contextmanager
def _open(path: Path, array_format: ArrayFormat) -> Iterator[Mapping[str, StoredArray]]:
    """The arrays of a file by name. Anything that cannot be read in it, then or later, raises
    BadInput.
    """
    try:
        with array_format.open_arrays(path) as arrays:
            yield arrays
    except BadInput:
        raise
    # Damaged bytes may make h5py, SciPy and the packages of data loggers raise anything.
    except Exception as error:
        message = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path}: cannot be read as {array_format.name}: {message}") from None


@contextmanager
def _open_hdf5(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    """The datasets of an HDF5 file, which are read when they are asked for."""
    with open_plain(path) as file:
        yield _list_datasets(file)


@contextmanager
def _open_matlab(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    """The arrays of an older file of MATLAB, those in structures by their path."""
    yield _list_matlab(path)


HDF5_FORMAT = ArrayFormat("HDF5", _open_hdf5)
MATLAB_FORMAT = ArrayFormat("a file of MATLAB", _open_matlab)


def _list_datasets(file: h5py.File) -> dict[str, StoredArray]:
    arrays: dict[str, StoredArray] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None:
            arrays[name] = StoredArray(name, item, dict(item.attrs))

    file.visititems(visit)
    return arrays


def _list_matlab(path: Path) -> dict[str, StoredArray]:
    arrays: dict[str, StoredArray] = {}

    def add(name: str, item: Any) -> None:
        value = np.asarray(item)
        if value.dtype.names and value.size == 1:
            for key in value.dtype.names:
                add(f"{name}/{key}", value[key].ravel()[0])
        elif value.dtype.kind in _NUMBERS:
            arrays[name] = StoredArray(name, value)

    for name, item in scipy.io.loadmat(path).items():
        if not name.startswith("__"):
            add(name, item)
    return arrays


class _NoColumn(Exception):
    """An array of which a name picks no column of numbers."""


def _find_array(
    path: Path, arrays: Mapping[str, StoredArray], name: str, meaning: str
) -> tuple[StoredArray, tuple[str, ...]]:
    """The array of a column, and what is picked of it. Raises BadInput where there is none."""
    # An array may itself be named `x[2]`, so the whole name is tried first.
    rest = name
    picked: tuple[str, ...] = ()
    while True:
        array = arrays.get(rest.strip("/"))
        if array is not None:
            return array, picked
        match = _PICKED.fullmatch(rest)
        if match is None:
            break
        rest = match[1]
        picked = (match[2], *picked)
    known = sorted(arrays)
    table, _, asked = rest.strip("/").rpartition("/")
    if table in arrays and arrays[table].fields:
        fields = ", ".join(arrays[table].fields)
        hint = f"{table} is a table of records with the fields {fields}; write {table}[{asked}]"
    elif known:
        hint = suggestion(rest, known)
    else:
        hint = "the file has no datasets"
    raise BadInput(f"{path}: column {name}, which is to hold {meaning}, is missing; {hint}")


def _pick(array: StoredArray, picked: tuple[str, ...], samples: int | None) -> Floats:
    """Values (m,) of a column. `samples` are those of the time, None for the time itself. Raises
    _NoColumn.
    """
    if array.fields:
        return _pick_field(array, picked)
    if array.data.dtype.kind not in _NUMBERS:
        raise _NoColumn(f"it holds {array.data.dtype}, no numbers")
    index = _as_index(array.name, picked)
    if len(array.shape) == 1:
        if index is not None and (index > 0 or len(array.data.shape) == 1):
            raise _NoColumn(_describe_vector(array, index))
        return array.convert(array.read())
    if len(array.shape) != 2:
        raise _NoColumn(
            f"{array.name} has {len(array.shape)} dimensions; a column comes from one or two"
        )
    count = _count_columns(array, samples)
    if index is None:
        raise _NoColumn(
            f"{array.name} has {count} columns; write {array.name}[0] to {array.name}[{count - 1}]"
        )
    if index >= count:
        raise _NoColumn(
            f"{array.name} has {count} columns, so the last is {array.name}[{count - 1}]"
        )
    if _is_transposed(array, samples):
        return array.convert(array.data[index, :])
    return array.convert(array.data[:, index])


def _describe_vector(array: StoredArray, index: int) -> str:
    if len(array.data.shape) == 1:
        return f"{array.name} has one dimension; leave [{index}] out"
    return f"{array.name} has 1 columns, so the last is {array.name}[0]"


def _is_transposed(array: StoredArray, samples: int | None) -> bool:
    """Whether the columns of a matrix lie along its rows, as MATLAB's do in HDF5."""
    rows, columns = array.shape
    if samples is None:
        return rows <= MOST_COLUMNS < columns
    return rows != samples == columns


def _pick_field(array: StoredArray, picked: tuple[str, ...]) -> Floats:
    """Values (m,) of a field of a table of records. Raises _NoColumn."""
    if not picked or picked[0] not in array.fields:
        fields = ", ".join(f"{array.name}[{name}]" for name in array.fields)
        raise _NoColumn(f"{array.name} is a table of records; write one of {fields}")
    values = array.read()[picked[0]]
    if values.dtype.kind not in _NUMBERS:
        raise _NoColumn(f"the field {picked[0]} holds {values.dtype}, no numbers")
    if values.ndim == 1 and len(picked) == 1:
        return np.asarray(values, dtype=np.float64)
    index = _as_index(f"{array.name}[{picked[0]}]", picked[1:])
    if values.ndim != 2 or index is None or index >= values.shape[1]:
        raise _NoColumn(f"the field {picked[0]} has the shape {values.shape[1:]} in each record")
    return np.asarray(values[:, index], dtype=np.float64)


def _as_index(name: str, picked: tuple[str, ...]) -> int | None:
    """The number in brackets behind a name; None without. Raises _NoColumn for anything else."""
    if not picked:
        return None
    if len(picked) > 1 or not picked[0].isdecimal():
        raise _NoColumn(f"{name} holds numbers; write {name}[0] for its first column")
    return int(picked[0])


def _describe(
    array: StoredArray, picked: tuple[str, ...] | None, samples: int | None
) -> Iterator[str]:
    """What is read otherwise than the numbers stand in the file, a sentence each."""
    scaled = array.find_scale()
    if scaled is not None and scaled[:2] != (1.0, 0.0):
        scale, offset, attribute = scaled
        words = f"{array.name}: its numbers times {scale:g}"
        if offset:
            words += f", plus {offset:g}"
        yield f"{words}, by its attribute {attribute}"
    is_matrix = len(array.shape) == 2 and not array.fields
    if is_matrix and (picked is None or picked) and _is_transposed(array, samples):
        yield f"{array.name}: its columns lie along the rows, as MATLAB writes them"


def _list_array(array: StoredArray, samples: int | None) -> dict[str, Floats | None]:
    """The columns (m,) of an array by name, None where they hold no finite numbers."""
    if array.fields:
        return {
            f"{array.name}[{name}]": finite_or_none(_pick_field(array, (name,)))
            for name in array.fields
            if array.data.dtype[name].kind in _NUMBERS and not array.data.dtype[name].shape
        }
    picked: dict[str, tuple[str, ...]] = {array.name: ()}
    if len(array.shape) == 2:
        count = _count_columns(array, samples)
        picked = {f"{array.name}[{index}]": (str(index),) for index in range(count)}
    if array.data.dtype.kind not in _NUMBERS:
        return dict.fromkeys(picked)
    return {name: finite_or_none(_pick(array, part, samples)) for name, part in picked.items()}
