"""Result of a fit, how far it can be trusted, and the model file with the fitted values."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.description.model_file import scale_keys, write_model
from rfca_rig.model.declarations.ground import HEIGHT_OFFSET
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]

# Pairs above it are reported.
HIGH_CORRELATION = 0.9


def correlation_of(covariance: Floats) -> Floats:
    """Correlations (p, p) of a covariance (p, p)."""
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def list_correlated_pairs(names: Sequence[str], covariance: Floats) -> list[tuple[str, str, float]]:
    """Pairs of parameters that the recordings hardly distinguish: |correlation| above
    HIGH_CORRELATION in a covariance (p, p).
    """
    correlation = correlation_of(covariance)
    pairs = [
        (i, j)
        for i in range(len(names))
        for j in range(i)
        if abs(correlation[i, j]) > HIGH_CORRELATION
    ]
    return [(names[j], names[i], float(correlation[i, j])) for i, j in pairs]


def describe_pair(pair: tuple[str, str, float]) -> str:
    """One such pair in words."""
    return (
        f"{pair[0]} and {pair[1]} are correlated to {pair[2]:+.2f}: the recordings hardly "
        "tell them apart"
    )


@dataclass(frozen=True)
class FittedParameter:
    """One parameter in `unit`. `prior_std` is None where no prior was stated; then `shift_in_std`
    counts its own `std` instead.

    `at_bound`: the fit stopped at five standard deviations of the prior, or at a physical limit.
    """

    name: str
    unit: str
    nominal: float
    prior_std: float | None
    value: float
    std: float
    shift_in_std: float
    at_bound: bool


@dataclass(frozen=True)
class Starts:
    """How many starts there were, and how many ended at the best point, which indicates a unique
    answer.
    """

    count: int
    agreeing: int


@dataclass(frozen=True)
class FitResult:
    """The best point of a fit.

    `x` (p,) are the coordinates of `space`, and `covariance` (p, p) is theirs. `chi2_before` and
    `chi2` are sums of the `residuals` whitened squares, without the prior's share. `rms_before`,
    `rms` and `noise` are by channel. `scatter` is one standard deviation of what differs from
    stroke to stroke, by parameter. `errors_from` describes the source of the standard errors.
    """

    space: Prior[ModelPoint]
    x: Floats
    covariance: Floats
    at_bound: NDArray[np.bool_]
    chi2_before: float
    chi2: float
    residuals: int
    strokes: int
    errors_from: str
    evaluations: int
    converged: bool
    starts: Starts = Starts(1, 1)
    scatter: Mapping[str, float] = field(default_factory=dict)
    rms_before: Mapping[str, float] = field(default_factory=dict)
    rms: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def supposed(self) -> ModelPoint:
        """Rig, height and start as fitted."""
        return self.space.at(self.x)

    @property
    def parameters(self) -> tuple[FittedParameter, ...]:
        """The fitted values, in the order of the space."""
        # Errors are first computed in the coordinates of the space, where the fit is nearly linear,
        # and then converted.
        std_x = np.sqrt(np.diag(self.covariance))
        stds = self.space.std_in_units(self.x, self.covariance)
        values = self.space.values(self.x)
        return tuple(
            self._parameter(i, float(values[i]), float(stds[i]), float(std_x[i]))
            for i in range(len(self.x))
        )

    def _parameter(self, i: int, value: float, std: float, std_x: float) -> FittedParameter:
        parameter = self.space.parameters[i]
        x = float(self.x[i])
        if self.space.has_prior[i]:
            # With a prior, x counts prior standard deviations by definition.
            prior_std = float(self.space.prior_std[i])
            shift_in_std = x
        else:
            prior_std = None
            shift_in_std = x / std_x
        return FittedParameter(
            name=parameter.name,
            unit=parameter.unit,
            nominal=float(self.space.centres[i]),
            prior_std=prior_std,
            value=value,
            std=std,
            shift_in_std=shift_in_std,
            at_bound=bool(self.at_bound[i]),
        )

    @property
    def correlation(self) -> Floats:
        """Correlation of the parameters' errors, (p, p)."""
        return correlation_of(self.covariance)

    def high_correlations(self) -> list[tuple[str, str, float]]:
        """Pairs that the recordings hardly distinguish."""
        return list_correlated_pairs(self.space.names, self.covariance)

    def plain(self) -> dict[str, Any]:
        """Everything as plain data, for JSON."""
        return {
            "format": "rfca-fit/1",
            "parameters": [_plain_parameter(parameter) for parameter in self.parameters],
            "correlation": [_round_row(row) for row in self.correlation],
            "chi2_before": self.chi2_before,
            "chi2": self.chi2,
            "residuals": self.residuals,
            "strokes": self.strokes,
            "errors_from": self.errors_from,
            "scatter": dict(self.scatter),
            "rms": {
                c: {"before": self.rms_before[c], "after": self.rms[c], "noise": self.noise[c]}
                for c in self.rms
            },
            "starts": vars(self.starts),
            "evaluations": self.evaluations,
            "converged": self.converged,
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """The result as lines for a terminal."""
        lines = [
            (
                f"{'parameter':<19}{'nominal':>11}{'prior std':>10}{'fitted':>11}"
                f"{'std':>9}{'shift':>8}  unit"
            ),
            *(_line(parameter) for parameter in self.parameters),
            (
                f"chi2 {self.chi2_before:.0f} -> {self.chi2:.0f} for {self.residuals} values "
                f"of {self.strokes} strokes; {self.errors_from}"
            ),
        ]
        if self.scatter:
            lines.append(f"from stroke to stroke: {_deviations(self.scatter)}")
        for c in self.rms:
            lines.append(
                f"{c}: rms {self.rms_before[c]:.3g} -> {self.rms[c]:.3g}, noise {self.noise[c]:.3g}"
            )
        lines += map(describe_pair, self.high_correlations())
        for parameter in self.parameters:
            if parameter.at_bound:
                lines.append(
                    f"{parameter.name} is at its bound: look for something that the model lacks"
                )
        if self.starts.count > 1:
            lines.append(f"{self.starts.agreeing} of {self.starts.count} starts agree")
        if not self.converged:
            lines.append("the solver had not converged when it stopped")
        return [*lines, *self.notes]


def _plain_parameter(parameter: FittedParameter) -> dict[str, Any]:
    values = {}
    for name, value in vars(parameter).items():
        key = name
        if name == "nominal":
            # The key keeps its older name, because it is part of the file format.
            key = "believed"
        values[key] = value
    return values


def _round_row(row: Floats) -> list[float]:
    """A row of the correlation (p,), with four decimals."""
    return [round(float(value), 4) for value in row]


def _line(p: FittedParameter) -> str:
    prior = "none"
    if p.prior_std is not None:
        prior = f"{p.prior_std:.3g}"
    return (
        f"{p.name:<19}{p.nominal:>11.5g}{prior:>10}{p.value:>11.5g}"
        f"{p.std:>9.2g}{p.shift_in_std:>+8.2f} "
        f" {p.unit}"
    ).rstrip()


def _deviations(scatter: Mapping[str, float]) -> str:
    return ", ".join(
        f"{name} {std:.2g} {PARAMETERS[name].unit}".rstrip() for name, std in scatter.items()
    )


def write_model_file(
    path: Path,
    result: FitResult,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, Any],
    sources: Iterable[str],
) -> None:
    """Write the fitted model, all or nothing.

    Parameters
    ----------
    path
        File to write.
    result
        The fit.
    nominal, known_to
        Sections that the fit began from.
    sources
        Names of the recordings.

    Raises
    ------
    RigError
        Where the disk refuses.
    """
    supposed = result.supposed
    sections = make_fitted_sections(nominal, supposed.rig, supposed.height_offset_m)
    comments = [*(f"Fitted to {source}" for source in sources), *result.lines(), *_remarks(result)]
    write_model(path, sections, make_fitted_known_to(known_to, result), comments)


def make_fitted_sections(
    nominal: Mapping[str, Any], rig: RigModel, height_offset_m: float = 0.0
) -> dict[str, Any]:
    """The sections leg, ground, sensor, drive and effects with the numbers of `rig`; values outside
    the model are kept from `nominal`.

    A rack that stands higher than stated is written as an effect.
    """
    leg = rig.leg
    ground = rig.ground
    stiffness: dict[str, Any]
    # k0 and k2, or the curve multiplied by the fitted factor.
    if leg.torque_splines:
        torque_rotation = nominal["leg"]["torque_rotation"]
        stiffness = {"torque_rotation": scale_keys(torque_rotation, leg.k0_Nm_per_rad)}
    else:
        stiffness = {"k0_Nm_per_rad": leg.k0_Nm_per_rad, "k2_per_rad2": leg.k2_per_rad2}
    rest_angles = {}
    if leg.rest_angles_rad:
        rest_angles["rest_angles_deg"] = [
            math.degrees(rest_rad) for rest_rad in leg.rest_angles_rad
        ]
    friction_lever = {}
    if ground.friction_lever_m is not None:
        friction_lever["friction_lever_mm"] = 1e3 * ground.friction_lever_m
    return {
        # Nominal keys come first: those without a counterpart in the model are kept.
        "leg": {
            **nominal["leg"],
            "link_lengths_mm": [1e3 * length_m for length_m in leg.link_lengths_m],
            "link_masses_g": [1e3 * mass_kg for mass_kg in leg.link_masses_kg],
            "link_radius_mm": 1e3 * leg.link_radius_m,
            **stiffness,
            "hinge_damping_Nm_s_per_rad": leg.hinge_damping_Nm_s_per_rad,
            "start_angle_rad": leg.start_angle_rad,
            **rest_angles,
        },
        "ground": {
            **nominal["ground"],
            "contact_stiffness_N_per_m1p5": ground.stiffness_N_per_m1p5,
            "contact_damping_s_per_m": ground.damping_s_per_m,
            "friction_coefficient": ground.friction_coefficient,
            "presliding_mm": 1e3 * ground.presliding_m,
            "tangential_damping_N_s_per_m": ground.drag_N_s_per_m,
            **friction_lever,
            "friction_rise_share": ground.friction_rise_share,
            "leaving_damping_share": ground.leaving_damping_share,
        },
        "sensor": {**nominal["sensor"], "below_shaft_mm": 1e3 * rig.sensor.below_shaft_m},
        "drive": {**nominal["drive"], "ramp_s": rig.drive.ramp_s},
        "effects": _effects(rig, 1e3 * height_offset_m),
    }


def _effects(rig: RigModel, offset_mm: float) -> list[dict[str, Any]]:
    """The effects of the rig; a height offset is added to one that the nominal model already
    has.
    """
    effects = []
    for present in rig.effects:
        effect: dict[str, Any] = {"id": present.id, "parameters": dict(present.values)}
        if present.table is not None:
            effect |= asdict(present.table)
        effects.append(effect)
    if not offset_mm:
        return effects
    # The nominal model already contains this offset, so the fitted one is added to it.
    nominal_mm = sum(
        dict(present.values)["offset_mm"]
        for present in rig.effects
        if present.id == HEIGHT_OFFSET.id
    )
    others = [effect for effect in effects if effect["id"] != HEIGHT_OFFSET.id]
    return [*others, {"id": HEIGHT_OFFSET.id, "parameters": {"offset_mm": nominal_mm + offset_mm}}]


def make_fitted_known_to(known_to: Mapping[str, Any], result: FitResult) -> dict[str, float]:
    """[known_to] with the standard errors of the fit in place of the values stated before;
    others stay as stated.
    """
    deviations = {key: float(value) for key, value in known_to.items() if value is not None}
    for fitted, parameter in zip(result.parameters, result.space.parameters, strict=True):
        if parameter.known_to is not None:
            # Keys of relative parameters are shares of the value.
            if parameter.relative:
                deviations[parameter.known_to] = fitted.std / abs(fitted.value)
            else:
                deviations[parameter.known_to] = fitted.std
    return deviations


def _remarks(result: FitResult) -> list[str]:
    """Comments on fitted parameters that have no key in the sections."""
    fitted = zip(result.parameters, result.space.parameters, strict=True)
    return [
        _remark(estimate)
        for estimate, parameter in fitted
        if estimate.name == "height" or parameter.known_to is None
    ]


def _remark(fitted: FittedParameter) -> str:
    if fitted.name == "height":
        return (
            f"The rack stood {fitted.value:+.3f} mm, known to {fitted.std:.3f} mm, from the "
            f"heights stated: effect {HEIGHT_OFFSET.id}."
        )
    return (
        f"{fitted.name} is known to {fitted.std:.3g} {fitted.unit} now; [known_to] has no key "
        "for it."
    )
