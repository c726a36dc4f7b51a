"""A made-up set with a source file of its own, in a registry of its own."""

import hashlib

import numpy as np

from rfca_rig.public_data import conversion, library
from rfca_rig.public_data.registry import (
    ConvertedFile,
    DatasetRegistry,
    PublicSet,
    RecordingGroup,
    SourceRepository,
)

PATH = "results/swing.csv"
CONTENT = "time,position,velocity,torque\n" + "".join(
    f"{0.01 * n:.18e},{np.sin(0.1 * n):.18e},{np.cos(0.1 * n):.18e},1.0\n" for n in range(50)
)


def use_made_up_set(monkeypatch, content=CONTENT):
    """A registry of one set, `simple` with a recording of this content; returns its source."""
    digest = hashlib.sha256(content.encode()).hexdigest()
    source = SourceRepository(
        "owner/name", "0" * 40, "MIT", "2020 Somebody", "A paper", {PATH: digest}
    )
    file = ConvertedFile("runs/ddp.csv", (PATH,), {})
    group = RecordingGroup("made/up", source, "simple pendulum", "nothing", (file,))
    made_up = PublicSet("simple", group, "test", "friction", "0.2 N m", ("joint_friction",))
    registry = DatasetRegistry({"up": source}, {group.name: group}, {made_up.name: made_up})
    monkeypatch.setattr(library, "read_registry", lambda: registry)
    fingerprint = (50.0, 0.284341, 0.719663, 0.694324, 1.0)
    monkeypatch.setattr(
        conversion, "read_fingerprints", lambda: {"made/up/runs/ddp.csv": fingerprint}
    )
    return source


def put_source(folder, source, content=CONTENT):
    """Put the source file where a folder of sources has it."""
    path = folder / source.name_of(PATH)
    path.parent.mkdir(parents=True)
    path.write_text(content, encoding="utf-8", newline="\n")
