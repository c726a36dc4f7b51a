"""A recording as one HDF5 file, `rfca-recording/1`.

    /            attributes format, title, source, sealed
    /believed    JSON text: leg, ground, sensor, drive of the nominal model
    /known_to    JSON text: one standard deviation of each nominal value
    /provenance  JSON text: text by name
    /strokes/001 attributes height_mm, speed_rad_s, repeat; a group per stream, see `strokes`
    /static      a column per quantity, a row per stage, see `static_table`
    /raw/001     samples of stages that are no strokes, see `strokes`

Behind the end stands a seal, see `hdf5_file`.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from rfca_rig.errors import BadInput
from rfca_rig.recording import strokes
from rfca_rig.recording.hdf5_file import SEALED, new_hdf5_file, open_plain, read_seal, run_to_completion
from rfca_rig.recording.model import Recording, Source, check_source, check_texts
from rfca_rig.recording.strokes import RAW, STROKES, read_raw_stages, read_strokes, write_raw_stages, write_strokes
from rfca_rig.recording.tables import read_static, write_static

FORMAT = "rfca-recording/1"
MOST_TITLE = 1000


def write_recording(recording: Recording, path: Path) -> Path:
    """Writes the recording to `path`, complete or not at all; the same recording always gives the same bytes. Returns `path`.

    Raises RigError when the disk refuses, ValueError for columns that are not equally long rows of numbers.
    """
    with new_hdf5_file(path) as made:
        mark_recording(made.root, recording, has_strokes=bool(recording.strokes or not recording.raw))
        write_strokes(made.root, recording.strokes, recording.source)
        write_static(made.root, recording.static)
        write_raw_stages(made.root, recording.raw, recording.source)
        run_to_completion(made.put_in_place())
    return path


def mark_recording(file: h5py.Group, recording: Recording, has_strokes: bool) -> None:
    """Writes everything except strokes and stages."""
    file.attrs["format"] = FORMAT
    file.attrs["title"] = recording.title
    file.attrs["source"] = recording.source
    strokes.mark_root(file, STROKES if has_strokes else RAW)
    # Datasets, because HDF5 attributes end at 64 kB and a plan may be longer.
    for name, content in (("believed", recording.nominal), ("known_to", recording.known_to), ("provenance", recording.provenance)):
        text = json.dumps(dict(content), ensure_ascii=False).encode()
        # Without track_times the file holds no date of its making, so that equal recordings give equal bytes.
        file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8", len(text)), track_times=False)


def read_recording(path: Path) -> Recording:
    """The recording in `path`, all of it in memory. Raises BadInput for a file that is damaged or of another kind."""
    with open_sealed(path) as (file, source):
        return Recording(
            title=read_title(file),
            source=source,
            nominal=read_text(file, "believed"),
            known_to=read_text(file, "known_to"),
            strokes=read_strokes(file, source),
            static=read_static(file),
            provenance=read_provenance(file),
            raw=read_raw_stages(file, source),
        )


def read_texts(path: Path, has_right_seal: bool = False) -> Recording:
    """The recording without its samples and stages. Raises BadInput as `read_recording` does."""
    with open_sealed(path, has_right_seal) as (file, source):
        return texts_of(file, source)


def texts_of(file: h5py.File, source: Source) -> Recording:
    """The same of an open file."""
    return Recording(read_title(file), source, read_text(file, "believed"), read_text(file, "known_to"), (), (), read_provenance(file))


@contextmanager
def open_sealed(path: Path, has_right_seal: bool = False) -> Iterator[tuple[h5py.File, Source]]:
    """Yields the open file and its source, after its seal was checked, unless it is known to be right.

    Raises BadInput for a damaged file or another format.
    """
    with report_damage(path):
        # Before HDF5 opens it: a damaged index can make the library search for ever.
        is_right = has_right_seal or read_seal(path)
        if is_right is False:
            raise ValueError("its checksum does not match, so bytes were changed after it was written")
        with open_plain(path) as file:
            if is_right is None and file.attrs.get(SEALED, False):
                raise ValueError("its checksum is gone from its end, so it was changed after it was written")
            found = file.attrs.get("format")
            if not isinstance(found, str) or found != FORMAT:
                description = f"format {str(found)[:60]!r}" if isinstance(found, str) else "an HDF5 file without format attribute"
                raise BadInput(f"{path}: {description}, where a recording of format {FORMAT!r} is needed")
            yield file, check_source(file.attrs["source"])


@contextmanager
def report_damage(path: Path) -> Iterator[None]:
    """Turns any error of HDF5 or of the layout into one message: this file is not a whole recording."""
    if not path.is_file():
        raise BadInput(f"{path}: is not there")
    try:
        yield
    # h5py raises nearly any of these for damaged bytes, depending on where they are.
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, MemoryError, ArithmeticError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path}: is not a whole recording of format {FORMAT!r}: {message[:240]}") from error


def read_text(file: h5py.File, name: str) -> dict[str, Any]:
    """A table of values by name. Raises ValueError for anything else."""
    content = json.loads(file[name][()])
    if not isinstance(content, dict):
        raise ValueError(f"{name} is not a table of values by name")
    return content


def read_provenance(file: h5py.File) -> dict[str, str]:
    """Text by name. Raises ValueError for anything else."""
    return check_texts(read_text(file, "provenance"))


def read_title(file: h5py.File) -> str:
    """Raises ValueError where it is no text, or longer than a page."""
    title = file.attrs["title"]
    if not isinstance(title, str) or len(title) > MOST_TITLE:
        raise ValueError(f"its title is no text of {MOST_TITLE} letters at most")
    return title
