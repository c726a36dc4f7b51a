"""Source files of public recordings: from a folder of this computer, else from GitHub.

The folder has the layout OWNER/NAME/COMMIT/PATH. It can be filled by hand where there is no
network. A file counts only if its SHA-256 is the registered one.
"""

import logging
import os
from collections.abc import Sequence
from pathlib import Path

import pooch

from rfca_rig.errors import BadInput
from rfca_rig.public_data.registry import SourceRepository

SOURCES_VARIABLE = "RFCA_RIG_DATASETS_SOURCES"
RECORDINGS_VARIABLE = "RFCA_RIG_DATASETS"
SERVER = "https://raw.githubusercontent.com/"
# Without an answer the name of the server, or the way to it, is not known. Common browsers wait
# as long; a source file of 2 MB takes less than 2 s on a slow line of 10 Mbit/s.
TIMEOUT_S = 30.0


def cache_folder() -> Path:
    """The folder of this program in the user's cache."""
    return Path(pooch.os_cache("rfca-rig")) / "datasets"


def sources_folder() -> Path:
    """Where source files are kept: RFCA_RIG_DATASETS_SOURCES, else in the user's cache."""
    stated = os.environ.get(SOURCES_VARIABLE)
    return Path(stated) if stated else cache_folder() / "sources"


def recordings_folder() -> Path:
    """Where converted recordings are kept: RFCA_RIG_DATASETS, else in the user's cache."""
    stated = os.environ.get(RECORDINGS_VARIABLE)
    return Path(stated) if stated else cache_folder() / "recordings"


def fetch_sources(source: SourceRepository, paths: Sequence[str]) -> list[Path]:
    """Files of a repository on this computer.

    Parameters
    ----------
    source
        The repository, with the SHA-256 of its files.
    paths
        Paths in the repository.

    Raises
    ------
    BadInput
        A file is not in the folder of sources and cannot be fetched, or it has another SHA-256.
    """
    pooch.get_logger().setLevel(logging.WARNING)
    folder = sources_folder()
    store = pooch.create(
        path=folder,
        base_url=SERVER,
        registry={source.name_of(path): digest for path, digest in source.sha256.items()},
    )
    download = pooch.HTTPDownloader(timeout=TIMEOUT_S)
    fetched = []
    for path in paths:
        name = source.name_of(path)
        try:
            fetched.append(Path(store.fetch(name, downloader=download)))
        # ValueError: the SHA-256 differs. OSError: no network, no such file, a full disk.
        except (OSError, ValueError) as error:
            raise BadInput(
                f"{path} of github.com/{source.repository} cannot be fetched "
                f"({_name_reason(error)}); connect this computer to the internet, or put the file "
                f"below {folder / source.name_of('')}"
            ) from error
    return fetched


def _name_reason(error: OSError | ValueError) -> str:
    """The kind of the error, without the long texts of the HTTP client."""
    if isinstance(error, ValueError):
        return "its SHA-256 is not the registered one"
    response = getattr(error, "response", None)
    if response is not None:
        return f"the server answers {response.status_code}"
    if isinstance(error, PermissionError):
        return f"{error.filename} may not be written"
    return "no connection to the server"
