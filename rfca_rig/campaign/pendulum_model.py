"""The model file of a pendulum: [link1], [link2] and [known_to] as in pendulum.toml, without recordings."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal

from rfca_rig.campaign.pendulum import PendulumCampaign, make_pendulum
from rfca_rig.campaign.pendulum_layout import MODEL_FORMAT, KnownToPendulum, LinkSection
from rfca_rig.description.sections import Section
from rfca_rig.description.toml import read_toml
from rfca_rig.description.toml_writing import comment, format_value, table
from rfca_rig.errors import BadInput
from rfca_rig.model.pendulum import Pendulum
from rfca_rig.recording.atomic import write_atomically


class PendulumModelFile(Section):
    """Layout of a pendulum's model file."""

    format: Literal["rfca-pendulum-model/1"]
    link1: LinkSection
    link2: LinkSection | None = None
    known_to: KnownToPendulum = KnownToPendulum()


def with_model_file(campaign: PendulumCampaign, path: Path) -> PendulumCampaign:
    """The campaign with the nominal values of the model file at `path`. Raises BadInput where it cannot be used or has other links."""
    described = read_toml(path, PendulumModelFile)
    pendulum = make_pendulum(described.link1, described.link2)
    ours, theirs = len(campaign.pendulum.links), len(pendulum.links)
    # [known_to] is replaced too, so both must describe the same pendulum.
    if ours != theirs:
        raise BadInput(f"{path}: a model of {theirs} links, but {campaign.title!r} has {ours}; give the model file of this pendulum")
    return replace(campaign, pendulum=pendulum, known_to=described.known_to.model_dump(exclude_none=True))


def write_pendulum_model(path: Path, pendulum: Pendulum, known_to: Mapping[str, float], comments: Iterable[str]) -> None:
    """Write a model file, all or nothing, with `comments` at its head. Raises RigError where the disk refuses."""
    head = f"format = {format_value(MODEL_FORMAT)}\n"
    links = [table(f"link{place}", asdict(link)) for place, link in enumerate(pendulum.links, start=1)]
    parts = ["".join(map(comment, comments)) + head, *links, table("known_to", known_to)]
    write_atomically(path, "\n".join(parts).encode("utf-8"))
