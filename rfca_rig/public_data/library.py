"""Public sets of recordings, as folders: `rr.datasets`."""

from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.public_data.conversion import convert_file
from rfca_rig.public_data.registry import PublicSet, read_registry
from rfca_rig.public_data.sources import (
    RECORDINGS_VARIABLE,
    cache_folder,
    fetch_sources,
    recordings_folder,
)

README = """{title}

Recordings: https://github.com/{repository}, commit {commit}, licence {licence}.
{credit}
Changed: {changed}
Omitted by the model: {concealed}
Published: {published}
"""

__all__ = ["PublicSet", "get", "names"]


def names() -> list[str]:
    """The names of all sets."""
    return list(read_registry().sets)


def get(
    name: str, out: str | Path | None = None, progress: Callable[[str], None] | None = None
) -> Path:
    """A set of public recordings as a folder with `experiment.toml`.

    Recordings are taken from the folder RFCA_RIG_DATASETS, else from the user's cache. Where they
    are in neither, their sources are fetched and converted once.

    Parameters
    ----------
    name
        The name of the set.
    out
        The folder to be made; one in the user's cache if not given.
    progress
        Called with a line for every file that is fetched.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    BadInput
        There is no such set, a source file cannot be fetched, or the folder exists with other
        content.
    """
    public_set = read_registry().find(name)
    folder = cache_folder() / "sets" / name if out is None else Path(out)
    if out is not None and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder}: is there already; name another folder with --out")
    recordings = provide_recordings(public_set, progress or (lambda _line: None))
    try:
        write_set(public_set, recordings, folder)
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written ({error.strerror})") from error
    return folder


def provide_recordings(public_set: PublicSet, progress: Callable[[str], None]) -> Path:
    """The folder of a set's recordings, after those that are missing were converted.

    Raises
    ------
    BadInput
        A source file cannot be fetched or converted, or the folder may not be written.
    """
    group = public_set.group
    folder = recordings_folder() / group.name
    for file in public_set.recordings:
        if (folder / file.name).is_file():
            continue
        progress(f"{group.source.repository}: {', '.join(file.sources)}")
        text = convert_file(group, file, fetch_sources(group.source, file.sources))
        try:
            (folder / file.name).parent.mkdir(parents=True, exist_ok=True)
            (folder / file.name).write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise BadInput(
                f"{folder / file.name}: cannot be written ({error.strerror}); set "
                f"{RECORDINGS_VARIABLE} to a folder of yours"
            ) from error
    return folder


def write_set(public_set: PublicSet, recordings: Path, folder: Path) -> None:
    """Write a set's description, model and recordings into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in public_set.files.items():
        (folder / name).write_bytes(path.read_bytes())
    for file in public_set.recordings:
        (folder / file.name).parent.mkdir(parents=True, exist_ok=True)
        (folder / file.name).write_bytes((recordings / file.name).read_bytes())
    source = public_set.group.source
    text = README.format(
        title=public_set.name,
        repository=source.repository,
        commit=source.commit,
        licence=source.licence,
        credit=source.credit,
        changed=public_set.group.changed,
        concealed=public_set.concealed,
        published=public_set.published,
    )
    (folder / "README.txt").write_text(text, encoding="utf-8")
