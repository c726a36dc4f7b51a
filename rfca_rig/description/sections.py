"""Sections that describe a rig, as written in campaign.toml, rig files and model files.

Every key carries its unit. Numbers must be finite, and unknown keys are refused. Units are
converted to SI in `nominal_model`.
"""

import math
from collections.abc import Mapping
from datetime import date
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, field_validator, model_validator
from pydantic_core import CoreSchema

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import resolve_effect
from rfca_rig.model.hinge_springs import knots_from
from rfca_rig.model.parameters import LawTable, PresentEffect
from rfca_rig.model.tabulated_law import TABULATED_LAW
from rfca_rig.toml import NotNegative, Positive, Section

_TABLE_KEYS = ("place", "argument", "knots", "values")
HINGE_LAW = "k0*phi + k0*k2*phi**3"
# Keys of [leg] that a measured curve replaces.
LAW_KEYS = ("hinge_torque_Nm", "k0_Nm_per_rad", "k2_per_rad2")
# Share of a covariance that may be lost by rounding to the digits of a file.
ROUNDED = 1e-4
# The torque's slope 1 + 3 k2 phi^2 is 0 at 90 degrees.
MIN_K2_PER_RAD2 = -4.0 / (3.0 * math.pi**2)

# Of the shaft: below, one stroke takes minutes and more samples than memory; above, no motor of
# these rigs turns.
SpeedRadS = Annotated[float, Field(ge=0.01, le=100)]
PositiveList = Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Rows = Annotated[tuple[Numbers, ...], Field(strict=False, min_length=1)]


class TorqueRotationSection(Section):
    """[leg.torque_rotation]: a measured curve of torque over the angle from rest, in place of k0
    and k2; see `model_file`.

    `torques_Nm` is one curve for all hinges, `torques_by_hinge_Nm` has one for each. Standard
    deviations or a covariance are those of `torques_Nm`. `curve` names a CSV file instead.
    """

    angles_deg: Numbers | None = None
    torques_Nm: Numbers | None = None
    torques_by_hinge_Nm: Rows | None = None
    standard_deviations_Nm: Annotated[tuple[NotNegative, ...], Field(strict=False)] | None = None
    covariance_Nm2: Rows | None = None
    curve: str | None = None

    @model_validator(mode="after")
    def _is_one_curve(self) -> "TorqueRotationSection":
        if self.curve is not None:
            given = [
                key
                for key in type(self).model_fields
                if key != "curve" and getattr(self, key) is not None
            ]
            if given:
                raise ValueError(f"curve names a file, so {given[0]} must be left out")
            return self
        if self.angles_deg is None or (self.torques_Nm is None) == (
            self.torques_by_hinge_Nm is None
        ):
            raise ValueError(
                "takes angles_deg with either torques_Nm or torques_by_hinge_Nm, or "
                "curve = a CSV file"
            )
        try:
            self.knots()
        except BadInput as error:
            raise ValueError(str(error)) from None
        return self

    @model_validator(mode="after")
    def _errors_fit(self) -> "TorqueRotationSection":
        std = self.standard_deviations_Nm
        covariance = self.covariance_Nm2
        angles = len(self.angles_deg or ())
        if (std is not None or covariance is not None) and self.torques_Nm is None:
            raise ValueError(
                "standard_deviations_Nm and covariance_Nm2 belong to torques_Nm, one "
                "curve for all hinges"
            )
        # The variances are on the diagonal already, and two statements could differ.
        if std is not None and covariance is not None:
            raise ValueError("give standard_deviations_Nm or covariance_Nm2, not both")
        if std is not None and len(std) != angles:
            raise ValueError(
                f"{angles} angles, but {len(std)} standard_deviations_Nm; give one per angle"
            )
        if covariance is not None:
            if {len(covariance), *map(len, covariance)} != {angles}:
                raise ValueError(
                    f"covariance_Nm2 must have {angles} rows of {angles} numbers, one for "
                    "each angle"
                )
            if min(row[i] for i, row in enumerate(covariance)) < 0.0:
                raise ValueError(
                    "covariance_Nm2 has a negative number on its diagonal, which holds "
                    "the variances"
                )
            matrix = np.array(covariance)
            # Rounding may leave a singular matrix with slightly negative eigenvalues.
            if np.abs(matrix - matrix.T).max() > ROUNDED * np.abs(matrix).max():
                raise ValueError(
                    "covariance_Nm2 is not symmetric: number j of row i must be number i of row j"
                )
            if np.linalg.eigvalsh(matrix).min() < -ROUNDED * np.trace(matrix):
                raise ValueError(
                    "covariance_Nm2 belongs to no torques: a correlation is beyond -1 to "
                    "1, or several contradict each other"
                )
        return self

    def knots(self) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
        """Angles [rad] and torques [N m] of the one curve, or of each hinge. Raises BadInput for
        an invalid curve.
        """
        if self.angles_deg is None:
            raise BadInput(
                f"the curve {self.curve} is in a file of its own, which has not been read"
            )
        if self.torques_by_hinge_Nm is None:
            return [knots_from(self.angles_deg, self.torques_Nm or (), "this curve")]
        # Hinges count from 2: link 1 turns on the shaft.
        hinges = enumerate(self.torques_by_hinge_Nm, start=2)
        return [
            knots_from(self.angles_deg, torques, f"the curve of hinge {hinge}")
            for hinge, torques in hinges
        ]


class AboutSection(Section):
    """[about]: who measured what and when, as it stands in the head of every page."""

    date: Annotated[str, Field(max_length=100)] = Field(
        default="", description="day or time of the measurement, as 2026-03-14"
    )
    operator: Annotated[str, Field(max_length=200)] = Field(default="", description="who measured")
    specimen: Annotated[str, Field(max_length=200)] = Field(
        default="", description="what was measured"
    )
    rig: Annotated[str, Field(max_length=200)] = Field(default="", description="on which rig")

    @field_validator("date", mode="before")
    @classmethod
    def _as_text(cls, value: Any) -> Any:
        # TOML has dates of its own; both ways of writing mean the same.
        if isinstance(value, date):
            return value.isoformat()
        return value


class LegSection(Section):
    """[leg]: straight links from the shaft outwards, one torsion spring per hinge, all hinges alike
    unless their curves differ.

    `hinge_torque_Nm` states the law of the springs, so that a file written for another law is
    refused. It, k0 and k2 are omitted where `torque_rotation` holds a measured curve. A negative k2
    means softening; the torque must grow up to 90 degrees.

    `start_angle_rad`, or `start_angle_deg`, is where a stroke begins, measured from the horizontal,
    positive downwards. `rest_angles_deg` are the angles of hinges 2, 3 .. without load, from which
    phi counts; without the key the leg is straight.
    """

    link_lengths_mm: PositiveList = Field(
        description="length of each link, from the shaft outwards"
    )
    link_masses_g: PositiveList = Field(description="mass of each link")
    link_radius_mm: Positive = Field(description="radius of a link's end, which touches the ground")
    hinge_torque_Nm: str | None = Field(description="law of the springs")
    k0_Nm_per_rad: Positive | None = Field(description="stiffness of a hinge at rest")
    k2_per_rad2: float | None = Field(description="hardening of a hinge; negative for softening")
    hinge_damping_Nm_s_per_rad: NotNegative = Field(description="viscous damping of a hinge")
    start_angle_rad: Annotated[float, Field(ge=-3.1416, le=3.1416)] = Field(
        description="where a stroke begins, from the horizontal, positive downwards"
    )
    rest_angles_deg: (
        Annotated[tuple[Annotated[float, Field(ge=-45, le=45)], ...], Field(strict=False)] | None
    ) = Field(default=None, description="angle of each hinge without load")
    torque_rotation: TorqueRotationSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _law_or_curve(cls, data: Any) -> Any:
        """A curve replaces three keys; without a curve they are required."""
        if not isinstance(data, Mapping) or data.get("torque_rotation") is None:
            return data
        given = [key for key in LAW_KEYS if data.get(key) is not None]
        if given:
            raise ValueError(
                f"torque_rotation takes the place of {', '.join(LAW_KEYS)}; leave out {given[0]}"
            )
        # The keys have no defaults, so that a leg without a curve must state them; None satisfies
        # the check.
        return {**data, **dict.fromkeys(LAW_KEYS)}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The schema for editors: the three keys of the law, or a curve."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        table = handler.resolve_ref_schema(schema)
        table["required"] = [key for key in table["required"] if key not in LAW_KEYS]
        table["allOf"] = [
            *table.get("allOf", ()),
            {"oneOf": [{"required": [*LAW_KEYS]}, {"required": ["torque_rotation"]}]},
        ]
        return schema

    @field_validator("hinge_torque_Nm")
    @classmethod
    def _is_known_law(cls, law: str | None) -> str | None:
        # Blanks do not matter; everything else does.
        if law is not None and "".join(law.split()) != "".join(HINGE_LAW.split()):
            raise ValueError(f'the only law known is "{HINGE_LAW}" (phi in rad)')
        return law

    @field_validator("k2_per_rad2")
    @classmethod
    def _grows(cls, k2: float | None) -> float | None:
        if k2 is not None and k2 < MIN_K2_PER_RAD2:
            raise ValueError(
                f"below {MIN_K2_PER_RAD2:.3f} the torque falls before 90 degrees; give a "
                "curve in [leg.torque_rotation]"
            )
        return k2

    @model_validator(mode="after")
    def _as_many_masses_as_lengths(self) -> "LegSection":
        lengths = len(self.link_lengths_mm)
        masses = len(self.link_masses_g)
        if lengths != masses:
            raise ValueError(
                f"link_lengths_mm names {lengths} links and link_masses_g {masses}; give "
                "one mass per length"
            )
        return self

    @model_validator(mode="after")
    def _a_curve_per_hinge(self) -> "LegSection":
        hinges = len(self.link_lengths_mm) - 1
        if self.torque_rotation is None:
            return self
        curves = self.torque_rotation.torques_by_hinge_Nm
        if curves is not None and len(curves) != hinges:
            raise ValueError(
                f"torque_rotation.torques_by_hinge_Nm has {len(curves)} curves, and the leg "
                f"{hinges} hinges; give one per hinge"
            )
        return self

    @model_validator(mode="after")
    def _an_angle_per_hinge(self) -> "LegSection":
        hinges = len(self.link_lengths_mm) - 1
        if self.rest_angles_deg is not None and len(self.rest_angles_deg) != hinges:
            raise ValueError(
                f"rest_angles_deg has {len(self.rest_angles_deg)} angles, and the leg "
                f"{hinges} hinges; give one per hinge"
            )
        return self


class GroundSection(Section):
    """[ground]: a level floor that each link end touches on its own.

    Normal force = stiffness * depth^1.5 * (1 + damping * approach speed). Coulomb friction with
    sticking acts at the lowest point.

    The last five keys are optional. Without them the floor has Coulomb friction, eq. (18), at a
    point that yields 0.1 mm before it slides. `tangential_damping_N_s_per_m` is a force
    proportional to the sliding speed, in full from a normal force of 1 N on. The default lever of
    friction about a link's end is the link's radius. Friction acts `friction_rise_share` of the
    depth above the lowest point. `leaving_damping_share` is the share of the damping that acts
    while an end leaves.

    A tie that carries mu N at 0.1 mm reproduces the touchdown of recorded strokes (a few newtons,
    3e4 N/m) and the reversals of static stages (50 N, 2e5 N/m). No fixed stiffness does both.
    """

    contact_stiffness_N_per_m1p5: Positive = Field(description="normal force over depth^1.5")
    contact_damping_s_per_m: NotNegative = Field(
        description="share of the normal force per approach speed"
    )
    friction_coefficient: Annotated[float, Field(ge=0, le=5)] = Field(
        description="Coulomb friction"
    )
    presliding_mm: Positive = Field(
        default=0.1, description="elastic deflection of a sticking point before it slides"
    )
    tangential_damping_N_s_per_m: NotNegative = Field(
        default=0.0, description="force over sliding speed, beside friction"
    )
    friction_lever_mm: float | None = Field(
        default=None,
        description="moment arm of friction about a link's end; the link's radius if not given",
    )
    friction_rise_share: float = Field(
        default=0.0, description="friction acts this share of the depth above the lowest point"
    )
    leaving_damping_share: float = Field(
        default=1.0, description="share of the damping that acts during lift-off"
    )


class NoiseStd(Section):
    """One standard deviation of a single sample, per channel; a channel without a key states
    none.
    """

    fx_N: NotNegative | None = None
    fy_N: NotNegative | None = None
    fz_N: NotNegative | None = None
    tx_Nm: NotNegative | None = None
    ty_Nm: NotNegative | None = None
    tz_Nm: NotNegative | None = None


class SensorSection(Section):
    """[sensor]: tx_Nm = shaft torque + below_shaft * fy_N. `tared` describes in words the load
    on the sensor when it was zeroed.
    """

    below_shaft_mm: float = Field(
        description="from the shaft axis down to the origin of the sensor"
    )
    noise_std: NoiseStd | None = None
    tared: str | None = Field(
        default=None, description="load on the sensor when it was zeroed, in words"
    )


class DriveSection(Section):
    """[drive]: the commanded speed rises linearly from 0 at t = 0 within `ramp_s` and is then held.

    `holds_start`: where the drive sags under load, its integrator carries the leg at the start.
    """

    ramp_s: Positive = Field(description="time in which the commanded speed rises from 0")
    holds_start: bool = Field(
        default=False, description="the integrator carries the leg's weight at the start"
    )
    mode: Literal["speed"] = Field(description="what is commanded")


class KnownToSection(Section):
    """[known_to]: one standard deviation of each nominal value. A fit may change these values;
    values without a key count as exact.

    `_relative` is a share of the nominal value, 0.03 for 3 %. `k0_relative` is that of a factor on
    the curve where the leg has one. `rest_angle_deg` is used by static reports only. The keys from
    `presliding_relative` on are rarely measured. A diagnosis varies them in any case, with a usual
    standard deviation where none is given here; 0 makes them exact.
    """

    height_mm: Positive | None = Field(
        default=None, description="height of the shaft above the ground"
    )
    start_angle_deg: Positive | None = Field(
        default=None, description="angle at which a stroke begins"
    )
    friction_coefficient: Positive | None = Field(
        default=None, description="friction of the ground"
    )
    k0_relative: Positive | None = Field(default=None, description="stiffness of the hinges")
    k2_relative: Positive | None = Field(default=None, description="hardening of the hinges")
    rest_angle_deg: Positive | None = Field(default=None, description="rest angle of the hinges")
    mass_relative: Positive | None = Field(default=None, description="mass of the links")
    hinge_damping_relative: Positive | None = Field(
        default=None, description="damping of the hinges"
    )
    contact_stiffness_relative: Positive | None = Field(
        default=None, description="stiffness of the ground"
    )
    presliding_relative: NotNegative | None = Field(
        default=None, description="presliding of the ground"
    )
    tangential_damping_N_s_per_m: NotNegative | None = Field(
        default=None, description="tangential damping of the ground"
    )
    friction_rise_share: NotNegative | None = Field(
        default=None, description="rise of the point where friction acts"
    )
    leaving_damping_share: NotNegative | None = Field(
        default=None, description="damping during lift-off"
    )
    swing_sags: NotNegative | None = Field(
        default=None,
        description="distance of the tip hinge from equilibrium at the start, in static sags",
    )
    swing_sags_per_s: NotNegative | None = Field(default=None, description="rate of that distance")
    command_delay_ms: NotNegative | None = Field(
        default=None, description="delay of the drive behind the command"
    )


class EffectSection(Section):
    """[[effects]]: a physical effect that acts, by its id in the catalogue, with a number for each
    of its parameters.

    Shape parameters of its law may be omitted.

    A number outside the plausible range is accepted, an impossible one is refused. A
    `tabulated_law` has no parameters: its force is linear between `values` at `knots`, as a
    function of the `argument` at the `place`.
    """

    id: str = Field(description="id in the catalogue")
    parameters: dict[str, float] = Field(default={}, description="a number for each parameter")
    place: str | None = Field(default=None, description="of a tabulated law: where the force acts")
    argument: str | None = Field(
        default=None, description="of a tabulated law: what the force depends on"
    )
    knots: Numbers | None = Field(
        default=None, description="of a tabulated law: values of the argument"
    )
    values: Numbers | None = Field(
        default=None, description="of a tabulated law: force at each knot"
    )

    @model_validator(mode="before")
    @classmethod
    def _has_a_table_or_parameters(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        # Before validation of the fields, so that the message can name the effect.
        id_ = data.get("id")
        given = [key for key in _TABLE_KEYS if data.get(key) is not None]
        if id_ != TABULATED_LAW and given:
            raise ValueError(
                f"effect {id_}: {given[0]} belongs to a {TABULATED_LAW}; give its numbers "
                "as parameters"
            )
        if id_ == TABULATED_LAW and data.get("parameters"):
            raise ValueError(
                f"effect {TABULATED_LAW}: takes {', '.join(_TABLE_KEYS)}; leave parameters out"
            )
        if id_ == TABULATED_LAW and len(given) < len(_TABLE_KEYS):
            missing = [key for key in _TABLE_KEYS if key not in given]
            raise ValueError(
                f"effect {TABULATED_LAW}: {', '.join(missing)} missing; it takes "
                f"{', '.join(_TABLE_KEYS)}"
            )
        if id_ != TABULATED_LAW and "parameters" not in data:
            raise ValueError(
                f"effect {id_}: parameters missing; give them as parameters = {{ NAME = VALUE }}"
            )
        return data

    @model_validator(mode="after")
    def _can_be(self) -> "EffectSection":
        try:
            effect, values = resolve_effect(self.present())
        except BadInput as error:
            raise ValueError(str(error)) from None
        for parameter in (*effect.parameters, *effect.shape):
            if (reason := parameter.why_not(values[parameter.name])) is not None:
                raise ValueError(
                    f"effect {self.id}: {parameter.name} = {values[parameter.name]:g} {reason}"
                )
        return self

    def present(self) -> PresentEffect:
        """The effect for the model."""
        if self.place is None or self.argument is None or self.knots is None or self.values is None:
            return PresentEffect(self.id, tuple(self.parameters.items()))
        return PresentEffect(
            self.id, table=LawTable(self.place, self.argument, self.knots, self.values)
        )


Effects = Annotated[tuple[EffectSection, ...], Field(strict=False)]


class RigSections(Section):
    """The four sections that together describe a rig, and the effects of its nominal model."""

    leg: LegSection
    ground: GroundSection
    sensor: SensorSection
    drive: DriveSection
    effects: Effects = ()
