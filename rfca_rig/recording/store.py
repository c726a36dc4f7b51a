"""A recording as one HDF5 file, `rfca-recording/1`.

    /            attributes format, title, source
    /believed    JSON text: leg, ground, sensor, drive as believed
    /known_to    JSON text: one standard deviation of each believed value
    /provenance  JSON text: text by name
    /strokes/001 attributes height_mm, speed_rad_s, repeat; a group per stream, see `strokes`
    /static      a column per quantity, a row per stage, see `static_table`
    /raw/001     samples of stages that are no strokes, see `raw_stages`

The file is put together in memory and reaches the disk by plain writes. A full disk is then an ordinary error; HDF5 that meets
one while closing a file can take the whole process down when it exits (h5py issue 914). Behind the end stands a `seal`.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import h5py

from rfca_rig.errors import BadInput
from rfca_rig.recording import nexus
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.form import Recording, Source
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.raw_stages import read_raw_stages, write_raw_stages
from rfca_rig.recording.seal import is_broken, sealed
from rfca_rig.recording.static_table import read_static, write_static
from rfca_rig.recording.strokes import read_strokes, write_strokes

FORMAT = "rfca-recording/1"
SOURCES = ("SIM", "REAL", "IMPORT")


def write_recording(recording: Recording, path: Path) -> Path:
    """Writes the recording to `path`, whole or not at all; the same recording gives the same bytes every time. Returns `path`.

    Raises RigError when the disk refuses, ValueError for columns that are not equally long rows of numbers.
    """
    write_atomically(path, image_of(recording))
    return path


def image_of(recording: Recording) -> bytes:
    """The bytes of the file that holds the recording."""
    with h5py.File("in memory", "w", driver="core", backing_store=False) as file:
        file.attrs["format"] = FORMAT
        file.attrs["title"] = recording.title
        file.attrs["source"] = recording.source
        nexus.mark_root(file, "strokes" if recording.strokes or not recording.raw else RAW)
        _write_text(file, "believed", recording.believed)
        _write_text(file, "known_to", recording.known_to)
        _write_text(file, "provenance", recording.provenance)
        write_strokes(file, recording.strokes, recording.source)
        write_static(file, recording.static)
        write_raw_stages(file, recording.raw, recording.source)
        file.flush()
        return sealed(file.id.get_file_image())


def read_recording(path: Path) -> Recording:
    """The recording in `path`, all of it in memory. Raises BadInput for a file that is damaged or of another kind."""
    with _damage_in(path), h5py.File(path, "r") as file:
        source = _checked_source(path, file)
        return Recording(
            title=str(file.attrs["title"]),
            source=source,
            believed=_read_text(file, "believed"),
            known_to=_read_text(file, "known_to"),
            strokes=read_strokes(file, source),
            static=read_static(file),
            provenance=_read_text(file, "provenance"),
            raw=read_raw_stages(file, source),
        )


def _checked_source(path: Path, file: h5py.File) -> Source:
    found = file.attrs.get("format")
    if found != FORMAT:
        said = f"format {found!r}" if found else "an HDF5 file without format attribute"
        raise BadInput(f"{path}: {said}, where a recording of format {FORMAT!r} is needed")
    source = file.attrs["source"]
    if source not in SOURCES:
        raise ValueError(f"source {source!r} is none of {', '.join(SOURCES)}")
    return cast(Source, source)


@contextmanager
def _damage_in(path: Path) -> Iterator[None]:
    """Whatever HDF5 or the layout stumbles over means one thing to the user: this file is not a whole recording."""
    if not path.is_file():
        raise BadInput(f"{path}: is not there")
    try:
        if is_broken(path.read_bytes()):
            raise ValueError("its checksum does not match, so bytes were changed after it was written")
        yield
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, MemoryError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path}: is not a whole recording of format {FORMAT!r}: {said[:160]}") from error


def _write_text(file: h5py.File, name: str, content: Mapping[str, Any]) -> None:
    """As a dataset, because HDF5 attributes end at 64 kB and a plan may be longer."""
    text = json.dumps(dict(content), ensure_ascii=False).encode()
    file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8", len(text)), track_times=False)


def _read_text(file: h5py.File, name: str) -> dict[str, Any]:
    content = json.loads(file[name][()])
    if not isinstance(content, dict):
        raise ValueError(f"{name} is not a table of values by name")
    return content
