"""Layout of campaign.toml, `rfca-campaign/1`."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, field_validator

from rfca_rig.description.sections import (
    AboutSection,
    DriveSection,
    GroundSection,
    KnownToSection,
    LegSection,
    Positive,
    Section,
    SensorSection,
)

FORMAT = "rfca-campaign/1"
FILE_NAME = "campaign.toml"


class _Run(Section):
    """`strokes_before` is the number of strokes that the leg had made in the campaign before this run; needed only to detect slow
    changes.
    """

    file: Annotated[str, Field(min_length=1)]
    strokes_before: Annotated[int, Field(ge=0)] | None = None

    @field_validator("file")
    @classmethod
    def _inside_the_folder(cls, file: str) -> str:
        if "\\" in file:
            raise ValueError("write / between folder and file")
        # Runs lie in the campaign's own folder, which is complete wherever it is copied.
        if file.startswith("/") or ".." in file.split("/"):
            raise ValueError("must lie inside the campaign's folder")
        return file


class DynamicRun(_Run):
    """One stroke: its file, its condition, and the number of the repeat."""

    experiment: Literal["dynamic"]
    height_mm: Positive
    speed_rad_s: Positive
    repeat: Annotated[int, Field(ge=1)]

    @property
    def condition(self) -> str:
        return f"{self.height_mm:g} mm, {self.speed_rad_s:g} rad/s, repeat {self.repeat}"


class StaticRun(_Run):
    """A table of settled stages. `held_s` is how long the shaft had been held at the middle of each reading; needed only for legs that
    creep.
    """

    experiment: Literal["static"]
    held_s: Positive | None = None


Run = Annotated[DynamicRun | StaticRun, Field(discriminator="experiment")]


class CampaignFile(Section):
    """campaign.toml: the nominal model before the campaign, the uncertainties of its values, and the runs."""

    format: Literal["rfca-campaign/1"]
    title: Annotated[str, Field(max_length=1000)]
    about: AboutSection = AboutSection()
    leg: LegSection
    ground: GroundSection
    sensor: SensorSection
    drive: DriveSection
    known_to: KnownToSection = KnownToSection()
    runs: Annotated[tuple[Run, ...], Field(strict=False, min_length=1)]

    def dynamic(self) -> Iterator[tuple[int, DynamicRun]]:
        """The dynamic runs, each with its index in `[[runs]]` from 0."""
        return ((place, run) for place, run in enumerate(self.runs) if isinstance(run, DynamicRun))

    def static(self) -> Iterator[tuple[int, StaticRun]]:
        """The static runs, each with its index in `[[runs]]` from 0."""
        return ((place, run) for place, run in enumerate(self.runs) if isinstance(run, StaticRun))
