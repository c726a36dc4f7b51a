"""A tolerances file: how near to the measured strokes a model must be, for `report --accept`."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rfca_rig.toml import NotNegative, Section, read_toml

PhaseName = Literal["rest", "free", "touchdown", "loading", "release", "rebound"]
# Up to 100 %, the borders of the band rise with the measured value. The order in which a window and
# a tolerance are applied then makes no difference.
Percent = Annotated[float, Field(ge=0, le=100)]
# Of a stroke, which takes a few seconds.
TimeMs = Annotated[float, Field(ge=0, le=10_000)]


class SignalToleranceSection(Section):
    """Tolerances of a signal over time. The larger one of the absolute and the relative tolerance
    counts at each moment.
    """

    relative_pct: Percent = Field(
        default=0.0, description="tolerance in percent of the measured value's magnitude"
    )
    lead_ms: TimeMs = Field(default=0.0, description="how much earlier the simulated signal may be")
    lag_ms: TimeMs = Field(default=0.0, description="how much later the simulated signal may be")
    phases: Annotated[tuple[PhaseName, ...], Field(strict=False, min_length=1)] | None = Field(
        default=None, description="phases of the stroke that are compared; all if not given"
    )


class ForceToleranceSection(SignalToleranceSection):
    """[fy] and [fz]: tolerances of a force over time, as those of [tx]."""

    absolute_N: NotNegative = Field(default=0.0, description="tolerance of the force")


class MomentToleranceSection(SignalToleranceSection):
    """[tx]: tolerances of the moment about the shaft's axis over time. The larger one of the
    absolute and the relative tolerance counts at each moment.
    """

    absolute_Nm: NotNegative = Field(default=0.0, description="tolerance of the moment")


class ValleyLimitsSection(Section):
    """[valley]: limits of each condition's errors in Table II, without sign."""

    time_error_pct: NotNegative | None = Field(
        default=None, description="largest error of the valley's time"
    )
    force_error_pct: NotNegative | None = Field(
        default=None, description="largest error of the valley's force"
    )

    @model_validator(mode="after")
    def _limits_something(self) -> "ValleyLimitsSection":
        if self.time_error_pct is None and self.force_error_pct is None:
            raise ValueError("takes time_error_pct, force_error_pct or both")
        return self


class TolerancesFile(Section):
    """A whole tolerances file. What has no table in it is not tested."""

    fy: ForceToleranceSection | None = None
    fz: ForceToleranceSection | None = None
    tx: MomentToleranceSection | None = None
    valley: ValleyLimitsSection | None = None

    @model_validator(mode="after")
    def _tests_something(self) -> "TolerancesFile":
        if not (self.fy or self.fz or self.tx or self.valley):
            raise ValueError("tests nothing; give one or more of [fy], [fz], [tx], [valley]")
        return self


def read_tolerances(path: Path) -> TolerancesFile:
    """Raises BadInput, with file and line, where the file cannot be used."""
    return read_toml(path, TolerancesFile)
