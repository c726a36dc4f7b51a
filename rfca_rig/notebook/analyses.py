"""Report, fit and diagnosis of recordings, with results as tables and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from rfca_rig import __version__
from rfca_rig.clock import WallClock
from rfca_rig.diagnosis.budget import allow_minutes
from rfca_rig.diagnosis.diagnose import diagnose as diagnose_problem
from rfca_rig.diagnosis.opening import open_problem
from rfca_rig.diagnosis.posterior_draws import draw_rivals
from rfca_rig.diagnosis.problem import DecidedSearch, Fit, FitOptions, Problem, Row
from rfca_rig.diagnosis.reference.problem import add_reference
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue, families_of
from rfca_rig.notebook.datatree import CHAINS, make_datatree
from rfca_rig.notebook.recordings import (
    OpenedRecordings,
    html_page,
    html_table,
    make_axes,
    make_frame,
    show_progress,
)
from rfca_rig.reports.diagnosis.files import write_diagnosis
from rfca_rig.reports.diagnosis.tables import all_misfits
from rfca_rig.reports.problems import ComparisonOptions, write_comparison

if TYPE_CHECKING:
    import pandas
    import xarray
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
    searches
        The searches that it rests on, by what was searched.
    """

    diagnosis: Diagnosis
    searches: Mapping[str, DecidedSearch] = field(repr=False)

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

    def to_datatree(
        self, search: str = "", draws: int = 500, seed: int = 0, least_probability: float = 0.01
    ) -> "xarray.DataTree":
        """Draws from the posterior in the groups that ArviZ reads, for its plots and comparisons.

        The groups at the root are those of the explanation that the answer rests on; below `rivals`
        are the groups of each set of effects, which has its probability as an attribute. Groups are
        posterior, prior, posterior_predictive, held_out_predictive, log_likelihood by condition,
        observed_data and constant_data.

        Parameters
        ----------
        search
            Which search, by its name in `searches`; the first if empty.
        draws
            Draws of each of four chains. All are independent.
        seed
            Of the draws.
        least_probability
            Of the rivals that are included.

        Raises
        ------
        BadInput
            For a search that there is not, or without xarray.
        """
        name = search or next(iter(self.searches))
        if name not in self.searches:
            known = ", ".join(self.searches)
            raise BadInput(f"search {name!r} was not made; there are {known}")
        random = np.random.default_rng(seed)
        finding = self.searches[name]
        rivals = draw_rivals(finding, least_probability, CHAINS * draws, random)
        described = {
            "title": self.diagnosis.title,
            "grade": self.grade,
            "sentence": self.sentence,
            "search": name,
            "seed": seed,
            "inference_library": "rfca-rig",
            "inference_library_version": __version__,
        }
        return make_datatree(finding.search.dataset.rows, rivals, described)

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

    fit: Fit
    rows: tuple[Row, ...]

    def table(self) -> "pandas.DataFrame":
        """A row per value: prior, fitted value and standard error."""
        return make_frame(self.rows)

    def _repr_html_(self) -> str:
        return html_table("fitted values", self.rows)


@dataclass(frozen=True)
class ReportResult:
    """A report: recordings beside their nominal model.

    Parameters
    ----------
    page
        The written page to open; None where nothing was written.
    html
        The page itself.
    rows
        Measured beside simulated: a row per condition of a leg as in Table II of the paper, a row
        per signal of each recording of a mechanism.
    """

    page: Path | None
    html: str
    rows: tuple[Row, ...]

    def table(self) -> "pandas.DataFrame":
        """The rows as a table."""
        return make_frame(self.rows)

    def _repr_html_(self) -> str:
        if self.page is None:
            return html_table("measured and simulated", self.rows) + html_page(self.html)
        return html_table(str(self.page), self.rows)


def diagnose(
    *sources: Source,
    without: Sequence[str] = (),
    law_at: str = "",
    as_is: bool = False,
    reference: Source | Sequence[Source] | None = None,
    minutes: float | None = None,
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
    reference
        Earlier recordings of the same rig, of a leg one or several; the answer is then what has
        changed since.
    minutes
        Time for the search, the answer is then the best so far; no limit if None.
    progress
        Show a bar, where tqdm is installed.

    Raises
    ------
    BadInput
        Where the recordings cannot be used, or an effect is not known.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    problem = _open_problem(sources, as_is)
    if reference is not None:
        earlier = (reference,) if isinstance(reference, Source) else tuple(reference)
        problem = add_reference(problem, _open_problem(earlier, as_is))
    with show_progress("diagnosis", progress) as move:
        budget = allow_minutes(WallClock(), minutes)
        answer = diagnose_problem(problem, move, without, law_at, budget=budget)
        return DiagnosisResult(answer.diagnosis, answer.searches)


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
    options = FitOptions(parameters, effects)
    problem = _open_problem(sources, as_is)
    problem.check_fit(options, None)
    with show_progress("fit", progress) as move:
        fitted = problem.fit(options, move)
    return FittedResult(fitted, fitted.rows())


def report(*sources: Source, out: str | Path | None = None, as_is: bool = False) -> ReportResult:
    """Compare recordings with their nominal model: a table and a page, which a notebook shows.

    Parameters
    ----------
    sources
        Opened recordings or paths.
    out
        Folder into which all pages and tables are written. Without it nothing is written.
    as_is
        Take values that are probably in another unit; otherwise they are refused with a guess. Of a
        leg.

    Raises
    ------
    BadInput
        Where the recordings cannot be used.
    """
    problem = _open_problem(sources, as_is)
    options = ComparisonOptions(as_is=as_is)
    if out is not None:
        written = write_comparison(problem, Path(out), options)
        page = written.pages[0]
        return ReportResult(page, page.read_text(encoding="utf-8"), written.rows)
    with TemporaryDirectory() as folder:
        written = write_comparison(problem, Path(folder), options)
        return ReportResult(None, written.pages[0].read_text(encoding="utf-8"), written.rows)


def effects(*sources: Source) -> "pandas.DataFrame":
    """A row per effect that a diagnosis of these recordings tries: id, where it acts, law,
    families, parameters with plausible ranges, source. Without recordings, the catalogue of a leg.

    Parameters
    ----------
    sources
        What `open` returned, or paths: recordings of one leg, or one mechanism.

    Raises
    ------
    BadInput
        Where the recordings cannot be used.
    """
    if sources:
        known = {effect.id: effect for effect in _open_problem(sources, as_is=False).list_effects()}
    else:
        known = catalogue()
    rows = (
        {
            "id": effect.id,
            "where": effect.where,
            "law": effect.law,
            "families": ", ".join(family.id for family in families_of(effect.id)),
            "parameters": "; ".join(f"{p.name} {p.low:g} to {p.high:g}" for p in effect.parameters),
            "source": effect.source,
        }
        for _, effect in sorted(known.items())
    )
    return make_frame(list(rows))


def _open_problem(sources: Sequence[Source], as_is: bool) -> Problem:
    """The recordings of all sources. Links to files outside a folder are followed where all
    sources were opened so.
    """
    allow_outside = all(
        isinstance(source, OpenedRecordings) and source.allow_outside for source in sources
    )
    return open_problem(_paths(sources), as_is, allow_outside)


def _paths(sources: Sequence[Source]) -> list[Path]:
    if not sources:
        raise BadInput("give recordings: a path, or what rr.open returned")
    return [
        source.path if isinstance(source, OpenedRecordings) else Path(source) for source in sources
    ]
