"""Layout of pendulum.toml, `rfca-pendulum/1`."""

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from rfca_rig.description.sections import AboutSection, NotNegative, Positive, Section
from rfca_rig.recording.layout import PENDULUM

FORMAT = "rfca-pendulum/1"
MODEL_FORMAT = "rfca-pendulum-model/1"
FILE_NAME = PENDULUM

# Delay of a torque behind the angles; swings are cut with a margin of twice that.
LONGEST_DELAY_S = 0.05

Text = Annotated[str, Field(min_length=1)]


class LinkSection(Section):
    """[link1], [link2]: nominal values of one link and the joint that carries it; see `model.pendulum.PendulumLink`."""

    length_m: Positive = Field(description="from joint to joint")
    mass_kg: Positive = Field(description="mass")
    centre_of_mass_m: NotNegative = Field(description="distance of the centre of mass from the joint")
    inertia_kg_m2: Positive = Field(description="inertia about the joint")
    joint_damping_Nm_s_per_rad: NotNegative = Field(default=0.0, description="viscous damping of the joint")
    joint_friction_Nm: NotNegative = Field(default=0.0, description="dry friction of the joint")
    torque_offset_Nm: float = Field(default=0.0, description="added to the recorded torque")
    driven: bool = Field(default=True, description="whether the joint has a motor")
    zero_offset_rad: float = Field(default=0.0, description="offset of the recorded angle")
    torque_delay_s: Annotated[float, Field(ge=-LONGEST_DELAY_S, le=LONGEST_DELAY_S)] = Field(
        default=0.0, description="delay of the torque behind the recording"
    )
    rotor_inertia_kg_m2: NotNegative = Field(default=0.0, description="rotor inertia times the gear ratio squared")

    @model_validator(mode="after")
    def _turns_heavily_enough(self) -> Self:
        least = self.mass_kg * self.centre_of_mass_m**2
        # Steiner: the inertia about the joint cannot be below that of a point mass at the centre of mass.
        if self.inertia_kg_m2 < least * (1.0 - 1e-9):
            raise ValueError(f"inertia_kg_m2 is about the joint and so at least {least:.4g}, mass times centre of mass squared")
        return self


class KnownToPendulum(Section):
    """[known_to]: the standard uncertainty of each nominal value, for each link independently. Values without a key count as exact."""

    mass_relative: Positive | None = Field(default=None, description="mass of a link; its inertia changes with it")
    centre_of_mass_m: Positive | None = Field(default=None, description="distance of the centre of mass from the joint")
    inertia_relative: Positive | None = Field(default=None, description="inertia about the joint")
    joint_damping_Nm_s_per_rad: Positive | None = Field(default=None, description="viscous damping; never below 0")
    joint_friction_Nm: Positive | None = Field(default=None, description="dry friction; never below 0")
    torque_offset_Nm: Positive | None = Field(default=None, description="added to the recorded torque")
    zero_offset_rad: Positive | None = Field(default=None, description="offset of the recorded angle")
    torque_delay_s: Annotated[float, Field(gt=0.0, le=LONGEST_DELAY_S / 2)] | None = Field(
        default=None, description="delay of the torque behind the recording"
    )
    rotor_inertia_kg_m2: Positive | None = Field(default=None, description="rotor inertia times the gear ratio squared; never below 0")
    torque_error_relative: Annotated[float, Field(ge=0.001, le=0.2)] | None = Field(
        default=None, description="usual error of the torques; 0.01 if not given"
    )


class ColumnsSection(Section):
    """[columns]: the column of each quantity in the CSV files. Speeds may be absent, and torques of joints without a motor."""

    t_s: Text
    angle1_rad: Text
    angle2_rad: Text | None = None
    speed1_rad_s: Text | None = None
    speed2_rad_s: Text | None = None
    torque1_Nm: Text | None = None
    torque2_Nm: Text | None = None

    def of(self, quantity: str) -> str | None:
        """The column of "angle1_rad" and so on."""
        found: str | None = getattr(self, quantity)
        return found


class NoiseSection(Section):
    """[noise_std]: noise of one sample. Where it is not given, it is estimated from neighbouring samples."""

    angle_rad: Positive | None = None
    speed_rad_s: Positive | None = None


class RunSection(Section):
    """One recording: its file, its condition in words, its repeat, and the part of it that counts."""

    file: Text = Field(description="recording, relative to this folder")
    condition: Text = Field(description="recordings of one condition are repeats")
    repeat: Annotated[int, Field(ge=1)] = Field(default=1, description="number of the repeat")
    from_s: float | None = Field(default=None, description="start of the part that counts")
    to_s: float | None = Field(default=None, description="end of the part that counts")

    @field_validator("file")
    @classmethod
    def _inside_the_folder(cls, file: str) -> str:
        if "\\" in file or file.startswith("/") or ".." in file.split("/"):
            raise ValueError("must lie inside the folder, with / between folder and file")
        return file

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.from_s is not None and self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s should be after from_s, {self.from_s:g} s")
        return self


class PendulumRunSection(RunSection):
    """`driven` false: the motors were off. Without the key, this is assumed for a run whose torques are all zero."""

    driven: bool | None = None


class PendulumFile(Section):
    """pendulum.toml: the nominal pendulum, the uncertainties of its values, and the runs."""

    format: Literal["rfca-pendulum/1"]
    title: Annotated[str, Field(max_length=1000)]
    about: AboutSection = AboutSection()
    link1: LinkSection
    link2: LinkSection | None = None
    known_to: KnownToPendulum = KnownToPendulum()
    columns: ColumnsSection
    noise_std: NoiseSection = NoiseSection()
    runs: Annotated[tuple[PendulumRunSection, ...], Field(strict=False, min_length=1)]

    @property
    def links(self) -> tuple[LinkSection, ...]:
        return (self.link1,) if self.link2 is None else (self.link1, self.link2)
