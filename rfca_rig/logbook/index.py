"""What was read last time, so that thousands of runs need not be read again. Only a cache: everything in it can be read from the files.

One file of SQLite in the folder of all runs. It is never changed: whoever has read something new writes another one beside it, which
takes its place at once and whole. So any number of processes may use it, on any disk, without waiting for each other, and what one
of them overwrites of another's is merely read once more.
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
VERSION = 2  # of what the rows hold; another is not read


@dataclass(frozen=True)
class IndexRow:
    """What was found in a file or folder when its stamp was that; `said` is plain data."""

    stamp: str
    said: Mapping[str, Any]


def read_index(runs: Path) -> dict[str, IndexRow]:
    """The rows by the path of what they are about; of a missing or damaged index those that are sound."""
    uri = f"file:{quote(str((runs / NAME).absolute()))}?mode=ro&immutable=1"
    rows: dict[str, IndexRow] = {}
    with suppress(sqlite3.Error, OSError), closing(sqlite3.connect(uri, uri=True)) as base:
        if base.execute("PRAGMA user_version").fetchone()[0] == VERSION:
            for path, stamp, text, check in base.execute("SELECT path, stamp, said, sum FROM rows"):
                if check == _sum(path, stamp, text):
                    rows[path] = IndexRow(stamp, json.loads(text))
    return rows


def write_index(runs: Path, rows: Mapping[str, IndexRow]) -> bool:
    """Puts the rows in place of what was there; False where the folder takes no file, and so everything will be read again."""
    made = runs / f"{NAME}.{os.getpid()}-{threading.get_ident()}"
    try:
        with suppress(FileNotFoundError):
            made.unlink()
        with closing(sqlite3.connect(made)) as base:
            _fill(base, ((path, row.stamp, json.dumps(row.said)) for path, row in rows.items()))
        made.replace(runs / NAME)
    except (sqlite3.Error, OSError, UnicodeError):  # a name that is no UTF-8 is no text of SQLite
        with suppress(OSError):
            made.unlink()
        return False
    return True


def _fill(base: sqlite3.Connection, rows: Iterable[tuple[str, str, str]]) -> None:
    base.execute("PRAGMA journal_mode = OFF")  # a file that nobody else knows yet
    base.execute("PRAGMA synchronous = OFF")
    base.execute(f"PRAGMA user_version = {VERSION}")
    base.execute("CREATE TABLE rows (path TEXT PRIMARY KEY, stamp TEXT, said TEXT, sum INTEGER) WITHOUT ROWID")
    base.executemany("INSERT INTO rows VALUES (?, ?, ?, ?)", ((*row, _sum(*row)) for row in rows))
    base.commit()


def _sum(path: object, stamp: object, text: object) -> int:
    """SQLite reads a row with flipped bits as if they were meant."""
    return zlib.crc32(f"{path}\0{stamp}\0{text}".encode(errors="surrogatepass"))
