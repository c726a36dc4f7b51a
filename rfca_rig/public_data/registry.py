"""What is known about each public set of recordings.

`sources.toml` names the repositories and their files, `recordings.toml` how the files become
recordings, `sets.toml` what each set omits on purpose and which statements are right.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

HERE = Path(__file__).parent
SETS = HERE / "sets"


@dataclass(frozen=True)
class SourceRepository:
    """A public repository at one commit.

    Parameters
    ----------
    repository
        Owner and name on GitHub.
    commit
        The whole hash of the commit.
    licence
        SPDX identifier.
    copyright
        Year and owner, as the licence file states them.
    publication
        What the repository asks to cite or belongs to; empty where it names none.
    sha256
        SHA-256 of each file that is used, by its path in the repository.
    """

    repository: str
    commit: str
    licence: str
    copyright: str
    publication: str
    sha256: Mapping[str, str]

    @property
    def url(self) -> str:
        """The page of the repository at this commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"

    @property
    def credit(self) -> str:
        """Owner and publication in a line."""
        owner = f"Copyright (c) {self.copyright}"
        return f"{owner}. Please cite: {self.publication}" if self.publication else owner

    def name_of(self, path: str) -> str:
        """OWNER/NAME/COMMIT/PATH of a file: its address below the server of raw files."""
        return f"{self.repository}/{self.commit}/{path}"


@dataclass(frozen=True)
class ConvertedFile:
    """One CSV file of a group of recordings.

    Parameters
    ----------
    name
        Its path in the folder of the group.
    sources
        Paths of the source files in the repository.
    options
        Arguments of the converter that differ from file to file.
    """

    name: str
    sources: tuple[str, ...]
    options: Mapping[str, Any]


@dataclass(frozen=True)
class RecordingGroup:
    """Recordings of one machine; several sets may use them.

    Parameters
    ----------
    name
        Its folder, as dfki-pendulum/simple.
    source
        The repository.
    converter
        Name of a function in `conversion.CONVERTERS`.
    changed
        In words, what differs from the source files.
    files
        The CSV files.
    """

    name: str
    source: SourceRepository
    converter: str
    changed: str
    files: tuple[ConvertedFile, ...]


@dataclass(frozen=True)
class PublicSet:
    """Recordings beside a model that omits something on purpose.

    Parameters
    ----------
    name
        The name by which it is got.
    group
        The recordings.
    split
        "development" if the recordings were looked at while the diagnosis was developed, "test" if
        not, "added" for sets that joined later.
    model
        The set whose model file is used; mostly its own.
    concealed
        What the model omits.
    published
        What the authors published about it.
    right
        Ids of the effects that agree with the publication; empty where silence is right.
    law
        Keys of [known_to] that a fit by hand moves.
    negligible
        Whether the omitted physics was published as negligible, so that silence is right, too.
    """

    name: str
    group: RecordingGroup
    split: str
    concealed: str
    published: str
    right: tuple[str, ...]
    law: tuple[str, ...] = ()
    model: str = ""
    negligible: bool = False

    @property
    def files(self) -> Mapping[str, Path]:
        """The description and the model file, which this project wrote, by name."""
        return {
            "experiment.toml": SETS / self.name / "experiment.toml",
            "model.xml": SETS / (self.model or self.name) / "model.xml",
        }

    @property
    def recordings(self) -> tuple[ConvertedFile, ...]:
        """The recordings of the group that its description names."""
        described = tomllib.loads(self.files["experiment.toml"].read_text(encoding="utf-8"))
        named = {recording["file"] for recording in described["recordings"]}
        return tuple(file for file in self.group.files if file.name in named)


@dataclass(frozen=True)
class DatasetRegistry:
    """All sets, groups and repositories, by name."""

    sources: Mapping[str, SourceRepository] = field(default_factory=dict)
    groups: Mapping[str, RecordingGroup] = field(default_factory=dict)
    sets: Mapping[str, PublicSet] = field(default_factory=dict)

    def find(self, name: str) -> PublicSet:
        """The set of this name.

        Raises
        ------
        BadInput
            There is none; with the names that there are.
        """
        if name not in self.sets:
            raise BadInput(f"{name}: no such set of recordings; {suggestion(name, self.sets)}")
        return self.sets[name]


@cache
def read_registry() -> DatasetRegistry:
    """The registry of the package."""
    sources = {name: SourceRepository(**entry) for name, entry in _read("sources.toml").items()}
    groups = {
        name: _make_group(name, entry, sources) for name, entry in _read("recordings.toml").items()
    }
    sets = {name: _make_set(name, entry, groups) for name, entry in _read("sets.toml").items()}
    return DatasetRegistry(sources, groups, sets)


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((HERE / name).read_text(encoding="utf-8"))


def _make_group(
    name: str, entry: dict[str, Any], sources: Mapping[str, SourceRepository]
) -> RecordingGroup:
    shared = {
        key: value
        for key, value in entry.items()
        if key not in ("source", "converter", "changed", "files")
    }
    files = []
    for file in entry["files"]:
        own = {key: value for key, value in file.items() if key not in ("name", "from")}
        files.append(ConvertedFile(file["name"], tuple(file["from"]), {**shared, **own}))
    return RecordingGroup(
        name, sources[entry["source"]], entry["converter"], entry["changed"], tuple(files)
    )


def _make_set(name: str, entry: dict[str, Any], groups: Mapping[str, RecordingGroup]) -> PublicSet:
    return PublicSet(
        name=name,
        group=groups[entry["recordings"]],
        split=entry["split"],
        concealed=entry["concealed"],
        published=entry["published"],
        right=tuple(entry["right"]),
        law=tuple(entry["law"]),
        model=entry.get("model", ""),
        negligible=entry.get("negligible", False),
    )
