"""Serves the runs below a folder to clients of Tiled, the data service of Bluesky.

A configuration file of Tiled names `catalogue`; docs/library.md has one. Clients search the runs by
their metadata, and read a stroke as an xarray dataset. Nothing can be written.
"""

import re
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from fastapi import HTTPException
from tiled.adapters.mapping import MapAdapter
from tiled.adapters.xarray import DatasetAdapter

from rfca_rig.campaign.experiment import measure_seconds
from rfca_rig.errors import BadInput
from rfca_rig.escaping import printable
from rfca_rig.logbook.entry import Entry
from rfca_rig.logbook.listing import list_runs
from rfca_rig.logbook.reading import read_entry
from rfca_rig.notebook.recordings import OpenedRecordings, open_path
from rfca_rig.notebook.runs import describe_run

# A client asks for the arrays of a stroke one by one. Recordings take up to hundreds of MB, so that
# only the last ones stay in memory.
MOST_OPEN = 4
# Tiled separates levels by a slash, and its client does not escape the others.
UNSAFE = re.compile(r"[/?#%\n\t]")
# The answer of HTTP to a request that is understood, but whose content cannot be processed.
UNPROCESSABLE = 422


def catalogue(folder: str | Path = "runs") -> MapAdapter:
    """The runs below a folder as a tree for a server of Tiled: runs, and in a run its strokes.

    Runs come in the order in which they began. A run's key is its folder, with `:` for `/` and for
    signs that end a path in a URL. Its metadata are the columns of `rr.runs`; what a run does not
    have is absent, because Tiled cannot compare a missing value. A stroke's key is its number in
    run.h5: `001` is `to_xarray(0)`.

    Runs are listed again with every search, so that a run which began meanwhile is there.

    Parameters
    ----------
    folder
        The folder that the runs lie below.

    Raises
    ------
    BadInput
        Where there is no such folder.
    """
    return MapAdapter(_Runs(Path(folder)))


class _Runs(Mapping[str, Any]):
    """The runs as containers by their keys; no recording is opened."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._entries: dict[str, Entry] = {}

    def __getitem__(self, key: str) -> MapAdapter:
        if key not in self._entries:
            self._list()
        entry = self._entries[key]
        # A client may ask for it again and again, without a listing, until it has ended.
        if entry.ended == "unfinished":
            entry = read_entry(self._folder, entry.folder)
        return _make_run(self._folder / entry.folder, entry)

    def __iter__(self) -> Iterator[str]:
        self._list()
        return iter(self._entries)

    def __len__(self) -> int:
        self._list()
        return len(self._entries)

    def _list(self) -> None:
        entries: dict[str, Entry] = {}
        # From the oldest on: a run keeps its key, whatever is recorded later.
        for entry in reversed(list_runs(self._folder, measure_s=measure_seconds)):
            key = self._key(entry)
            while key in entries:
                key += ":"
            entries[key] = entry
        self._entries = entries

    def _key(self, entry: Entry) -> str:
        # A folder that is itself a run; URLs drop a dot.
        if entry.folder == ".":
            return UNSAFE.sub(":", printable(self._folder.resolve().name))
        return UNSAFE.sub(":", printable(entry.folder))


# An entry is another one as soon as anything of its run has changed.
@cache
def _make_run(path: Path, entry: Entry) -> MapAdapter:
    described = describe_run(path, entry)
    # Text, which can be compared with the text of a query.
    described["began"] = described["began"].isoformat()
    metadata = {name: _plain(value) for name, value in described.items() if value is not None}
    return MapAdapter(_Strokes(path, entry), metadata=metadata)


def _plain(value: Any) -> Any:
    """As JSON has it, which has neither tuples nor halves of surrogate pairs."""
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, str):
        return printable(value)
    return value


class _Strokes(Mapping[str, Any]):
    """The strokes of a run by their numbers; the first that is asked for opens the recording."""

    def __init__(self, path: Path, entry: Entry) -> None:
        self._path = path
        self._entry = entry
        count = entry.strokes + entry.swings + entry.motions
        self._numbers = {f"{number + 1:03d}": number for number in range(count)}

    def __getitem__(self, key: str) -> DatasetAdapter:
        number = self._numbers[key]
        try:
            dataset = _open(self._path, self._entry).to_xarray(number)
        except BadInput as error:
            raise HTTPException(UNPROCESSABLE, str(error)) from None
        return DatasetAdapter.from_dataset(dataset)

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


@lru_cache(maxsize=MOST_OPEN)
def _open(path: Path, entry: Entry) -> OpenedRecordings:  # noqa: ARG001
    # The entry is part of the key: a run that has changed is opened again.
    return open_path(path)
