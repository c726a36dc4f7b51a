"""The sections that describe a rig, as people write them in campaign.toml, rig files and model files.

Every key carries its unit; numbers must be finite; an unknown key is refused. Units are turned into SI in `believed`.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import LawTable, PresentEffect
from rfca_rig.model.setup import resolved
from rfca_rig.model.tabulated_law import TABULATED_LAW

_TABLE_KEYS = ("place", "argument", "knots", "values")
HINGE_LAW = "k0*phi + k0*k2*phi**3"

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
PositiveList = Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]


class Section(BaseModel):
    """A table that people write: no key beyond those named, no text where a number belongs, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class LegSection(Section):
    """[leg]: straight links from the shaft outwards, one torsion spring per hinge, all hinges alike.

    `hinge_torque_Nm` states the only law that the model knows, so that a file written for another law is refused.
    `start_angle_rad` is where a stroke begins, measured from the horizontal, positive downwards. `rest_angles_deg` are the angles of hinges
    2, 3 .. without load, from which phi counts; without the key the leg is straight.
    """

    link_lengths_mm: PositiveList
    link_masses_g: PositiveList
    link_radius_mm: Positive
    hinge_torque_Nm: str
    k0_Nm_per_rad: Positive
    k2_per_rad2: NotNegative
    hinge_damping_Nm_s_per_rad: NotNegative
    start_angle_rad: Annotated[float, Field(ge=-3.1416, le=3.1416)]
    rest_angles_deg: Annotated[tuple[Annotated[float, Field(ge=-45, le=45)], ...], Field(strict=False)] | None = None

    @field_validator("hinge_torque_Nm")
    @classmethod
    def _known_law(cls, law: str) -> str:
        if "".join(law.split()) != "".join(HINGE_LAW.split()):
            raise ValueError(f'the only law known is "{HINGE_LAW}" (phi in rad)')
        return law

    @model_validator(mode="after")
    def _as_many_masses_as_lengths(self) -> "LegSection":
        lengths, masses = len(self.link_lengths_mm), len(self.link_masses_g)
        if lengths != masses:
            raise ValueError(f"link_lengths_mm names {lengths} links and link_masses_g {masses}; give one mass per length")
        return self

    @model_validator(mode="after")
    def _an_angle_per_hinge(self) -> "LegSection":
        hinges = len(self.link_lengths_mm) - 1
        if self.rest_angles_deg is not None and len(self.rest_angles_deg) != hinges:
            raise ValueError(f"rest_angles_deg has {len(self.rest_angles_deg)} angles, and the leg {hinges} hinges; give one per hinge")
        return self


class GroundSection(Section):
    """[ground]: a level floor that each link end touches on its own.

    Normal force = stiffness * depth^1.5 * (1 + damping * approach speed); Coulomb friction with stick at the lowest point.
    The last five keys are optional. Without them the floor is that of eq. (18), Coulomb's, with a point that yields 0.1 mm before it
    slides. `tangential_damping_N_s_per_m` is a force proportional to the sliding speed, in full from a normal force of 1 N on. The lever
    of friction about a link's end is the link's radius where none is given; friction acts `friction_rise_share` of the depth above the
    lowest point, and that share of the damping which the last key tells acts while an end leaves. A tie that carries mu N at 0.1 mm
    reproduces both the touchdown of recorded strokes (a few newtons, 3e4 N/m) and the reversals of static stages (50 N, 2e5 N/m), which no
    fixed stiffness does.
    """

    contact_stiffness_N_per_m1p5: Positive
    contact_damping_s_per_m: NotNegative
    friction_coefficient: Annotated[float, Field(ge=0, le=5)]
    presliding_mm: Positive = 0.1
    tangential_damping_N_s_per_m: NotNegative = 0.0
    friction_lever_mm: float | None = None
    friction_rise_share: float = 0.0
    leaving_damping_share: float = 1.0


class NoiseStd(Section):
    """One standard deviation of a single sample, per channel; a channel that is left out is not stated."""

    fx_N: NotNegative | None = None
    fy_N: NotNegative | None = None
    fz_N: NotNegative | None = None
    tx_Nm: NotNegative | None = None
    ty_Nm: NotNegative | None = None
    tz_Nm: NotNegative | None = None


class SensorSection(Section):
    """[sensor]: tx_Nm = shaft torque + below_shaft * fy_N. `tared` says in words what the sensor bore when it was zeroed."""

    below_shaft_mm: float
    noise_std: NoiseStd | None = None
    tared: str | None = None


class DriveSection(Section):
    """[drive]: the commanded speed rises linearly from 0 at t = 0 within `ramp_s` and is then held.

    `holds_start`: should it sag under load, its integrator carries the leg at the start.
    """

    ramp_s: Positive
    holds_start: bool = False
    mode: Literal["speed"]


class KnownToSection(Section):
    """[known_to]: one standard deviation of each believed value. A fit may move these; what is not listed counts as exact.

    `_relative` is a share of the believed value, 0.03 for 3 %. What hardly anybody measures, from `presliding_relative` on, is moved by a
    diagnosis in any case, with a usual standard deviation where none is listed here; 0 makes it exact.
    """

    height_mm: Positive | None = None
    start_angle_deg: Positive | None = None
    friction_coefficient: Positive | None = None
    k0_relative: Positive | None = None
    k2_relative: Positive | None = None
    mass_relative: Positive | None = None
    hinge_damping_relative: Positive | None = None
    contact_stiffness_relative: Positive | None = None
    presliding_relative: NotNegative | None = None
    tangential_damping_N_s_per_m: NotNegative | None = None
    friction_rise_share: NotNegative | None = None
    leaving_damping_share: NotNegative | None = None
    swing_sags: NotNegative | None = None
    swing_sags_per_s: NotNegative | None = None
    command_delay_ms: NotNegative | None = None


class EffectSection(Section):
    """[[effects]]: a piece of physics switched on, by its id in the catalogue, with a number for each of its parameters.

    Shape parameters of its law may be left out.

    A number beyond what is plausible is taken, one that cannot be is refused. A `tabulated_law` has no parameters: its force is straight
    between `values` at `knots`, as a function of the `argument` at the `place`.
    """

    id: str
    parameters: dict[str, float] = {}
    place: str | None = None
    argument: str | None = None
    knots: Numbers | None = None
    values: Numbers | None = None

    @model_validator(mode="before")
    @classmethod
    def _has_a_table_or_parameters(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        id_, given = data.get("id"), [key for key in _TABLE_KEYS if data.get(key) is not None]
        if id_ != TABULATED_LAW and given:
            raise ValueError(f"effect {id_}: {given[0]} belongs to a {TABULATED_LAW}; give its numbers as parameters")
        if id_ == TABULATED_LAW and data.get("parameters"):
            raise ValueError(f"effect {TABULATED_LAW}: takes {', '.join(_TABLE_KEYS)}; leave parameters out")
        if id_ == TABULATED_LAW and len(given) < len(_TABLE_KEYS):
            missing = [key for key in _TABLE_KEYS if key not in given]
            raise ValueError(f"effect {TABULATED_LAW}: {', '.join(missing)} missing; it takes {', '.join(_TABLE_KEYS)}")
        if id_ != TABULATED_LAW and "parameters" not in data:
            raise ValueError(f"effect {id_}: parameters missing; give them as parameters = {{ NAME = VALUE }}")
        return data

    @model_validator(mode="after")
    def _can_be(self) -> "EffectSection":
        try:
            effect, values = resolved(self.present())
        except BadInput as error:
            raise ValueError(str(error)) from None
        for parameter in (*effect.parameters, *effect.shape):
            if (reason := parameter.why_not(values[parameter.name])) is not None:
                raise ValueError(f"effect {self.id}: {parameter.name} = {values[parameter.name]:g} {reason}")
        return self

    def present(self) -> PresentEffect:
        """The same for the model."""
        if self.place is None or self.argument is None or self.knots is None or self.values is None:
            return PresentEffect(self.id, tuple(self.parameters.items()))
        return PresentEffect(self.id, table=LawTable(self.place, self.argument, self.knots, self.values))


Effects = Annotated[tuple[EffectSection, ...], Field(strict=False)]


class RigSections(Section):
    """The four sections that together describe a rig, and the effects that are believed to act in it."""

    leg: LegSection
    ground: GroundSection
    sensor: SensorSection
    drive: DriveSection
    effects: Effects = ()
