"""Report, fit and diagnosis of recordings, with results as tables and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rfca_rig.analysis.compare import Table2
from rfca_rig.analysis.fitting.result import FitResult
from rfca_rig.analysis.fitting.strokes import fit_recordings
from rfca_rig.campaign.experiment import Experiment
from rfca_rig.campaign.opening import experiment_among, open_with_nominal_model
from rfca_rig.diagnosis.diagnose import diagnose as diagnose_leg
from rfca_rig.diagnosis.mechanisms.diagnose import diagnose_mechanism
from rfca_rig.diagnosis.mechanisms.fit import fit_mechanism
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.window_fit import WindowFit
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue, families_of
from rfca_rig.notebook.recordings import (
    OpenedRecordings,
    Row,
    html_table,
    make_axes,
    make_frame,
    open_path,
    show_progress,
)
from rfca_rig.recording.model import Recording
from rfca_rig.reports.diagnosis.files import write_diagnosis
from rfca_rig.reports.diagnosis.tables import all_misfits
from rfca_rig.reports.strokes.page import write_report

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

Source = OpenedRecordings | str | Path
Z_90 = 1.6448536269514722  # standard deviations to either end of a 90 % interval


@dataclass(frozen=True)
class DiagnosisResult:
    """The graded answer of a diagnosis.

    Parameters
    ----------
    diagnosis
        The whole answer as plain values.
    """

    diagnosis: Diagnosis

    @property
    def grade(self) -> str:
        """identified, mostly, family, nothing missing, unexplained or not enough data."""
        return self.diagnosis.grade

    @property
    def sentence(self) -> str:
        """The answer in words."""
        return self.diagnosis.sentence

    @property
    def probability(self) -> float | None:
        """Probability of what is stated."""
        return self.diagnosis.probability

    def effects(self) -> "pandas.DataFrame":
        """A row per parameter of each stated effect, with the ends of its 90 % interval."""
        return make_frame(
            self._effect_rows(),
            ("effect", "probability", "parameter", "value", "low_90", "high_90"),
        )

    def rivals(self) -> "pandas.DataFrame":
        """A row per set of effects that was compared, most probable first."""
        rows = (
            {
                "effects": ", ".join(rival.ids) or "none",
                "probability": rival.probability,
                "log_evidence": rival.log_evidence,
                "model_error": rival.model_error,
            }
            for rival in self.diagnosis.rivals
        )
        return make_frame(list(rows))

    def errors(self) -> "pandas.DataFrame":
        """A row per signal: rms error of the nominal and of the amended model, and on held-out
        conditions.
        """
        return make_frame(
            self._error_rows(),
            ("signal", "before", "after", "held_out_before", "held_out_after", "noise"),
        )

    def save(self, folder: str | Path) -> Path:
        """Write diagnosis.html, diagnosis.json and the tables into `folder`; returns the page."""
        write_diagnosis(self.diagnosis, Path(folder))
        return Path(folder) / "diagnosis.html"

    def plot(self, number: int = 0, ax: "Axes | None" = None) -> "Axes":
        """Draw one measured signal with the nominal and the amended model into `ax`, or into a
        new figure.
        """
        overlays = self.diagnosis.overlays
        if not 0 <= number < len(overlays):
            raise BadInput(
                f"there are {len(overlays)} signals to draw, numbered from 0; there is no {number}"
            )
        ax = make_axes(ax)
        shown = overlays[number]
        for label, values in (
            ("measured", shown.measured),
            ("nominal model", shown.before),
            ("amended model", shown.after),
        ):
            ax.plot(shown.t_s, values, label=label, linestyle="-" if label == "measured" else "--")
        ax.set(xlabel="time in s", ylabel=shown.signal, title=shown.condition)
        ax.legend()
        return ax

    def _effect_rows(self) -> list[Row]:
        return [
            {
                "effect": effect.id,
                "probability": effect.probability,
                "parameter": name,
                "value": value.value,
                "low_90": value.value - Z_90 * value.std,
                "high_90": value.value + Z_90 * value.std,
            }
            for effect in self.diagnosis.effects
            for name, value in effect.parameters.items()
        ]

    def _error_rows(self) -> list[Row]:
        rows: list[Row] = []
        for name, misfit in all_misfits(self.diagnosis).items():
            held_out = self.diagnosis.held_out.get(f"held_out_{name}")
            rows.append(
                {
                    "signal": name,
                    "before": misfit.before,
                    "after": misfit.after,
                    "held_out_before": None if held_out is None else held_out.before,
                    "held_out_after": None if held_out is None else held_out.after,
                    "noise": misfit.noise_floor,
                }
            )
        return rows

    def __repr__(self) -> str:
        probability = "" if self.probability is None else f" ({self.probability:.1%})"
        return f"{self.grade}{probability}: {self.sentence}"

    def _repr_html_(self) -> str:
        return html_table(repr(self), self._effect_rows()) + html_table(
            "rms error", self._error_rows()
        )


@dataclass(frozen=True)
class FittedResult:
    """A fit of values of the nominal model.

    Parameters
    ----------
    fit
        The whole result.
    rows
        A row per value.
    """

    fit: FitResult | WindowFit
    rows: tuple[Row, ...]

    def table(self) -> "pandas.DataFrame":
        """A row per value: prior, fitted value and standard error."""
        return make_frame(self.rows)

    def _repr_html_(self) -> str:
        return html_table("fitted values", self.rows)


@dataclass(frozen=True)
class ReportResult:
    """A written report.

    Parameters
    ----------
    page
        The page to open.
    table2
        Table II of the paper: measured and simulated valleys.
    """

    page: Path
    table2: Table2

    def table(self) -> "pandas.DataFrame":
        """A row per condition."""
        return make_frame(self._rows())

    def _rows(self) -> list[Row]:
        return [
            {
                "height_mm": round(1e3 * row.height_m, 6),
                "speed_rad_s": row.speed_rad_s,
                "repeats": row.repeats,
                "measured_time_s": row.time.mean,
                "measured_fz_N": row.fz.mean,
                "simulated_time_s": row.simulated_time_s,
                "simulated_fz_N": row.simulated_fz_N,
                "time_error_pct": row.time_error_pct,
                "force_error_pct": row.force_error_pct,
            }
            for row in self.table2.rows
        ]

    def _repr_html_(self) -> str:
        return html_table(str(self.page), self._rows())


def diagnose(
    *sources: Source,
    without: Sequence[str] = (),
    law_at: str = "",
    as_is: bool = False,
    progress: bool = True,
) -> DiagnosisResult:
    """Say which physics the model of recordings lacks, with size and probability.

    Parameters
    ----------
    sources
        Opened recordings or paths; several of one leg count together, with one nominal model.
    without
        Ids of effects that are known to be absent.
    law_at
        Place where a law is measured as well, see `docs/measured-laws.md`.
    as_is
        Take values that are probably in another unit or of another sign; otherwise they are refused
        with a guess.
    progress
        Show a bar, where tqdm is installed.

    Raises
    ------
    BadInput
        Where the recordings cannot be used, or an effect is not known.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    experiment = _with_own_model(sources)
    with show_progress("diagnosis", progress) as move:
        if experiment is not None:
            return DiagnosisResult(
                diagnose_mechanism(experiment, move, without, law_at, as_is).diagnosis
            )
        return DiagnosisResult(
            diagnose_leg(_recordings(sources, as_is), move, None, without, law_at)
        )


def fit(
    *sources: Source,
    parameters: Sequence[str] = (),
    effects: Sequence[str] = (),
    as_is: bool = False,
    progress: bool = True,
) -> FittedResult:
    """Fit values of the nominal model to recordings.

    Parameters
    ----------
    sources
        Opened recordings or paths; several of one leg count together.
    parameters
        Names of the values; all that `known_to` lists if empty.
    effects
        Of a mechanism: ids of effects that are put into the model.
    as_is
        Take values that are probably in another unit or of another sign; otherwise they are refused
        with a guess.
    progress
        Show a bar, where tqdm is installed.

    Raises
    ------
    BadInput
        Where the recordings cannot be used, or a name is not known.
    """
    experiment = _with_own_model(sources)
    if effects and experiment is None:
        raise BadInput(
            "effects: are for recordings of a mechanism (experiment.toml); leave them out here"
        )
    with show_progress("fit", progress) as move:
        if experiment is not None:
            return _of_windows(
                fit_mechanism(experiment, move, list(parameters), list(effects), as_is).fit
            )
        leg_fit = fit_recordings(_recordings(sources, as_is), list(parameters))
    return FittedResult(leg_fit, tuple(vars(value) for value in leg_fit.parameters))


def _of_windows(window_fit: WindowFit) -> FittedResult:
    shifts = tuple(
        {"name": s.name, "shift": s.value, "std": s.std, "prior_std": s.prior_std}
        for s in window_fit.shifts
    )
    sizes = tuple(
        {"name": f"{s.effect}.{s.name}", "shift": s.value, "std": s.std, "prior_std": None}
        for s in window_fit.sizes
    )
    return FittedResult(window_fit, shifts + sizes)


def report(*sources: Source, out: str | Path = "report", as_is: bool = False) -> ReportResult:
    """Compare recordings of a leg with their nominal model, and write the report.

    Parameters
    ----------
    sources
        Opened recordings or paths.
    out
        Folder of the report.
    as_is
        Take values that are probably in another unit; otherwise they are refused with a guess.

    Raises
    ------
    BadInput
        Where the recordings cannot be used; of pendulums and mechanisms the command `rfca-rig
        report` writes the page.
    """
    written = write_report(_recordings(sources, as_is), Path(out))
    return ReportResult(written.pages[0], written.table)


def effects() -> "pandas.DataFrame":
    """The catalogue of effects of the leg: id, where it acts, law, families, parameters with
    plausible ranges, source.
    """
    rows = (
        {
            "id": effect.id,
            "where": effect.where,
            "law": effect.law,
            "families": ", ".join(family.id for family in families_of(effect.id)),
            "parameters": "; ".join(f"{p.name} {p.low:g} to {p.high:g}" for p in effect.parameters),
            "source": effect.source,
        }
        for _, effect in sorted(catalogue().items())
    )
    return make_frame(list(rows))


def _with_own_model(sources: Sequence[Source]) -> Experiment | None:
    """The only source, where it has a model of its own; None for recordings of a leg. Raises
    BadInput where it is one of several.
    """
    paths = _paths(sources)
    # It refuses such a folder beside others.
    if experiment_among(paths) is None:
        return None
    content = (
        sources[0] if isinstance(sources[0], OpenedRecordings) else open_path(sources[0])
    ).content
    if isinstance(content, Recording):
        return None
    return content


def _recordings(sources: Sequence[Source], as_is: bool) -> list[Recording]:
    recordings = []
    for source, path in zip(sources, _paths(sources), strict=True):
        allow_outside = isinstance(source, OpenedRecordings) and source.allow_outside
        recordings += open_with_nominal_model([path], as_is, allow_outside)
    return recordings


def _paths(sources: Sequence[Source]) -> list[Path]:
    if not sources:
        raise BadInput("give recordings: a path, or what rr.open returned")
    return [
        source.path if isinstance(source, OpenedRecordings) else Path(source) for source in sources
    ]
