"""Cache of what was read last time, so that thousands of runs need not be read again. It can be rebuilt from the files.

One SQLite file in the folder of all runs. It is never changed: a process that has read something new writes another one beside it, which
replaces it at once and whole. So any number of processes may use it, on any disk, without waiting for each other. What one of them
overwrites of another's is merely read once more.
"""

import json
import os
import sqlite3
import threading
import zlib
from collections.abc import Iterable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

NAME = ".rfca-rig-index.sqlite3"
# Of the rows' content; an index of another version is not read.
VERSION = 2


@dataclass(frozen=True)
class IndexRow:
    """What was read from a file or folder when it had that stamp; `said` is plain data."""

    stamp: str
    said: Mapping[str, Any]


def read_index(runs: Path) -> dict[str, IndexRow]:
    """The rows by path; of a missing or damaged index those that are sound."""
    # immutable: SQLite then takes no locks and writes nothing beside the file, which network disks may not bear.
    uri = f"file:{quote(str((runs / NAME).absolute()))}?mode=ro&immutable=1"
    rows: dict[str, IndexRow] = {}
    with suppress(sqlite3.Error, OSError), closing(sqlite3.connect(uri, uri=True)) as base:
        if base.execute("PRAGMA user_version").fetchone()[0] == VERSION:
            for path, stamp, text, check in base.execute("SELECT path, stamp, said, sum FROM rows"):
                # A damaged row is skipped; its run is read again.
                if check == _sum(path, stamp, text):
                    rows[path] = IndexRow(stamp, json.loads(text))
    return rows


def write_index(runs: Path, rows: Mapping[str, IndexRow]) -> bool:
    """Replaces the index by one with these rows; False where the folder is not writable, so that all will be read again."""
    # A name of its own for each process and thread: two may write at the same time.
    new_file = runs / f"{NAME}.{os.getpid()}-{threading.get_ident()}"
    try:
        with suppress(FileNotFoundError):
            new_file.unlink()
        with closing(sqlite3.connect(new_file)) as base:
            _fill(base, ((path, row.stamp, json.dumps(row.said)) for path, row in rows.items()))
        new_file.replace(runs / NAME)
    # A name that is no UTF-8 is no text of SQLite.
    except (sqlite3.Error, OSError, UnicodeError):
        with suppress(OSError):
            new_file.unlink()
        return False
    return True


def _fill(base: sqlite3.Connection, rows: Iterable[tuple[str, str, str]]) -> None:
    # Neither journal nor sync: no other process knows the file yet, and a lost cache costs only time.
    base.execute("PRAGMA journal_mode = OFF")
    base.execute("PRAGMA synchronous = OFF")
    base.execute(f"PRAGMA user_version = {VERSION}")
    base.execute("CREATE TABLE rows (path TEXT PRIMARY KEY, stamp TEXT, said TEXT, sum INTEGER) WITHOUT ROWID")
    base.executemany("INSERT INTO rows VALUES (?, ?, ?, ?)", ((*row, _sum(*row)) for row in rows))
    base.commit()


def _sum(path: object, stamp: object, text: object) -> int:
    """Checksum of a row: SQLite takes flipped bits in it for data."""
    return zlib.crc32(f"{path}\0{stamp}\0{text}".encode(errors="surrogatepass"))
