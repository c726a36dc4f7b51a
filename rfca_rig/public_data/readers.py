"""Columns of source files, by name; a function for each form of file."""

import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from rfca_rig.errors import BadInput

Columns = Mapping[str, NDArray[np.float64]]
SPREADSHEET = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"


def read_csv_columns(path: Path) -> Columns:
    """Columns of a CSV file with one line of names, each (samples,)."""
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",", ndmin=2)
    return dict(zip(names, values.T, strict=True))


def read_free_swing(path: Path) -> NDArray[np.float64]:
    """Angles in degrees (samples,), one on each line, behind a line of names and one of values."""
    return np.loadtxt(path, skiprows=2)


def read_streams(paths: Sequence[Path]) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
    """Streams of numbers behind the index of their sample, joined.

    Parameters
    ----------
    paths
        A file for each stream: index, then its values, separated by tabs.

    Returns
    -------
    tuple
        The indices that all streams have (samples,), and of each stream its values there
        (samples, values).
    """
    streams = [np.loadtxt(path, ndmin=2) for path in paths]
    common = streams[0][:, 0]
    for stream in streams[1:]:
        common = np.intersect1d(common, stream[:, 0])
    values = [stream[np.isin(stream[:, 0], common), 1:] for stream in streams]
    return common.astype(np.int64), values


def read_matlab(path: Path) -> Mapping[str, NDArray[np.generic]]:
    """Variables of a MATLAB file up to version 7, by name; matrices (rows, columns)."""
    try:
        return dict(loadmat(path))
    except (NotImplementedError, ValueError) as error:
        raise BadInput(f"{path}: cannot be read as a MATLAB file: {error}") from error


def read_workbook_sheet(path: Path, title: str) -> list[list[str]]:
    """The cells of a sheet of a workbook (Office Open XML) as texts, row by row.

    Raises
    ------
    BadInput
        The file is no such workbook, or has no sheet of this title.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            sheet = ElementTree.fromstring(archive.read(_find_sheet(path, archive, title)))
            texts = _read_shared_texts(archive)
    except zipfile.BadZipFile as error:
        raise BadInput(f"{path}: is no workbook in Office Open XML") from error
    rows = []
    for row in sheet.iter(f"{SPREADSHEET}row"):
        rows.append([_read_cell(cell, texts) for cell in row.iter(f"{SPREADSHEET}c")])
    return rows


def _find_sheet(path: Path, archive: zipfile.ZipFile, title: str) -> str:
    """The name of the sheet's file in the archive."""
    workbook = ElementTree.fromstring(archive.read("xl/workbook.xml"))
    relations = ElementTree.fromstring(archive.read("xl/_rels/workbook.xml.rels"))
    targets = {relation.get("Id"): relation.get("Target", "") for relation in relations}
    for sheet in workbook.iter(f"{SPREADSHEET}sheet"):
        if sheet.get("name") == title:
            target = targets[sheet.get(RELATION)]
            return "xl/" + target.removeprefix("/xl/")
    raise BadInput(f"{path}: has no sheet {title!r}")


def _read_shared_texts(archive: zipfile.ZipFile) -> list[str]:
    if "xl/sharedStrings.xml" not in archive.namelist():
        return []
    table = ElementTree.fromstring(archive.read("xl/sharedStrings.xml"))
    return ["".join(entry.itertext()) for entry in table.iter(f"{SPREADSHEET}si")]


def _read_cell(cell: ElementTree.Element, texts: Sequence[str]) -> str:
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return "".join(cell.itertext())
    value = cell.find(f"{SPREADSHEET}v")
    text = "" if value is None else value.text or ""
    if kind == "s" and re.fullmatch(r"\d+", text):
        return texts[int(text)]
    return text
