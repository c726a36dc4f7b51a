"""All constants of the likelihood, the search and the decision, in one place, and which effects are
candidates.

Each states its unit and its origin. `docs/method.md` lists them with the sensitivity of the
answers. Constants that describe a kind of rig (bins, stages, limits of a drive) stand with that
rig.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.declarations import MECHANISM
from rfca_rig.model.effect import Effect
from rfca_rig.suggestions import suggestion

# Likelihood

# No law is exact: a model that lacks nothing still errs by about this much.
# half-normal size of the error of a model that lacks nothing, as a share of the signal
USUAL_ERROR = 0.01
NAMED_ERRORS = (
    0.005,
    0.0075,
    0.01,
    0.015,
    0.02,
    0.03,
)  # share of the signal; below the first no real leg and model agree
UNKNOWN_ERRORS = (
    0.03,
    0.045,
    0.07,
    0.12,
    0.2,
    0.35,
    0.6,
)  # share of the signal, log-uniform: something unlisted
GOOD_FIT = 0.011  # share of the signal: a model error that leaves next to nothing to be explained
# prior deviations of a nuisance parameter: an effect may do its work; no credible value
STRAINED = 2.5
IMPLAUSIBLE = 3.5
CONDITION_CORRELATION = 0.5  # correlation of the discrepancy between conditions
ROUGH_VARIANCE_SHARE = 1e-3  # share of the discrepancy's variance that is not smooth
# Of a set of that size. Within a size the prior is spread evenly over all sets, see
# `hypotheses.log_prior_of_set`.
# probabilities
PRIOR_NOTHING = 0.5
PRIOR_UNKNOWN = 0.1
PRIOR_ONE = 0.3
PRIOR_TWO = 0.1
PRIOR_THREE = 0.02
PRIOR_FOUR = 0.004  # a fifth of three, as three is a fifth of two

# Parameters

MAX_COORDINATE = 4.0  # prior deviations: the optimiser goes no farther
OCTAVE = 2.0  # high over low: wider positive ranges are log-uniform

# Optimiser

STEP = 0.1  # prior deviations: the first difference, where no slope is known
# the same of a single Jacobian that no step corrects: it averages over the roughness of contact
WIDE_STEP = 0.3
# deviations of all rows together by which a difference should move them: touchdown, stick and slip
# make the model rough
DIFFERENCE_SIZE = 4.0
# prior deviations: limits of a difference
NARROWEST_STEP = 0.03
WIDEST_STEP = 0.7
JACOBIAN_ERROR = 0.3  # share of its size by which a slope errs after some steps
# deviations of all rows together by which the model jumps from one place to the next
MODEL_ROUGHNESS = 1.0
# steps at one discrepancy scale, scales, and rounds with fresh Jacobians, at most
ROUNDS = 8
LEVELS = 5
CONVERGENCE_ROUNDS = 4
STEP_REDUCTION = 0.4  # share of the way after a step that did not help
# Steps in a row that did not help, after which the Jacobian is recomputed: of 12 poor starts 6
# arrive with 2, none without
FAILED_STEPS = 2
CONVERGED_GAIN = 0.5  # log posterior density, about how rough the model is
# log posterior density: a step that gains less is the last, as many of them along a curved valley
# gain several units
LEAST_GAIN = 0.02
# cosine, in units of noise, from which two columns of the Jacobian are the same
SAME_COLUMN_COSINE = 0.995

# Screening

# of an effect with one size, equally probable a priori; each further size takes one point from
# every axis
GRID_POINTS = 4
# a signature may be this much too small and still be a start: its shape decides
MAX_RESCALING = 3.0

# Search

# effects of one hypothesis; one more where it takes the place of a strained nuisance parameter
LARGEST_SET = 3
# Log evidence: more than convergence with fresh Jacobians brings (20 to 60), and more than four
# conditions rank otherwise than all do
CLOSE_LOG_EVIDENCE = 100.0
# sets of a size that are fitted on all conditions however far behind: the best without an effect
# measures its support
ALWAYS_FITTED = 3


@dataclass(frozen=True)
class SearchConfig:
    """How widely, and how long, hypotheses are searched. The counts of fits and the shares trade
    simulations against missed explanations.

    Parameters
    ----------
    coarse_conditions
        Dynamic conditions of the subset on which starts are screened and first fitted. Four corners
        of a 3 x 3 grid of heights and speeds rank effects as all nine do.
    starts_per_effect
        Grid points from which one effect is fitted beside the nominal model.
    probed_again
        Grid points of one effect that are simulated beside another fit than the nominal model:
        those that promise most there by the signatures that are known.
    singles_coarse, pairs_coarse
        Sets of each size that are fitted on the subset, of those that promise most beside the
        nominal model.
    beside_nothing
        The same of those that promise most beside the fit without effects, singles and pairs each.
    singles_full, pairs_full, triples_full
        Sets of each size that go on to all conditions.
    parents
        Fits beside which partners are screened again, by what each partner would do to a model that
        has the first effect already.
    partners
        Partners fitted beside each parent.
    converged
        Fits of each size that are brought to their MAP with fresh Jacobians.
    worth_a_fit
        Chi-square that an effect must promise to remove, or it is not fitted: less cannot pay for
        its parameters (Occam factor of about 3 in log evidence each).
    worth_trying_once
        The same of the most promising effect of a family none of which is fitted otherwise: only
        what was fitted is known not to be missing, and far from a fit the promise of a signature is
        no guide.
    worth_beside_a_good_fit
        The same beside an explanation that is adequate already: what a law that is off by some
        percent leaves.
    worth_a_probe
        Share of these that an effect must promise by a signature that is known, or it is not
        simulated again beside another fit.
    singles_only
        Whether the search ends after single effects. That is enough to choose the length of
        windows.
    budget
        Time that it may take.
    """

    coarse_conditions: int = 4
    starts_per_effect: int = 2
    probed_again: int = 8
    singles_coarse: int = 12
    pairs_coarse: int = 10
    beside_nothing: int = 4
    singles_full: int = 6
    pairs_full: int = 4
    triples_full: int = 2
    parents: int = 2
    partners: int = 5
    converged: int = 2
    worth_a_fit: float = 6.0
    worth_trying_once: float = 2.0
    worth_beside_a_good_fit: float = 60.0
    worth_a_probe: float = 0.3
    singles_only: bool = False
    budget: TimeBudget = UNLIMITED


DEFAULT_SEARCH = SearchConfig()

# Decision

FEWEST_CONDITIONS = 3  # for a verdict: with two, one is held out and one is left
# calibrated probabilities of an effect that is identified, and of one that is stated
IDENTIFIED_PROBABILITY = 0.9
STATED_PROBABILITY = 0.8
# share of the removable held-out misfit that an omission which is "most of it" explains: more than
# all others together
DOMINANT_SHARE = 0.5
# Held-out rms in units of noise and usual model error, up to which a law holds. It carries the
# uncertainty of the parameters, too: exact laws reach 1.06 with four conditions, and what a wrong
# law leaves of an unlisted cause begins at 1.24 in 196 benchmark cases.
USUAL_MISFIT = 1.2
# Share of the signal, a scale of UNKNOWN_ERRORS: seven times the usual error. Evidence that is left
# with so poor a model does not rest on how small a model error was supposed to be.
LARGE_ERROR = 0.07
# share by which a statement may make the held-out rms of a quantity larger: what linear prediction
# errs by
MAX_RISE = 0.05
# of nothing in the table of all sets, above which nothing is missing: more probable than all others
# together
NOTHING_PROBABILITY = 0.5
VISIBLE_PROBABILITY = 0.01  # of a set in that table, from which its effects are not excluded
AS_GOOD_LOG_ODDS = 3.0  # log posterior odds within which the data do not tell two effects apart
# share of the held-out mean square that an effect must remove to be part of the explanation
WORTH_ADDING = 0.1
# Share of what it explains that the law of a right effect may leave: friction laws of real gears
# are right to 20 to 40 % of themselves, so a second law of the same family that leaves less could
# be the true one.
LAW_ERROR = 0.2
# Least standard deviation by which a real cause departs from its law in the catalogue, of its size
# and of what shapes it, as a share: with them 90 % intervals of 58 parameters hold 54 truths, where
# a simulator with other laws concealed the effects
LAW_SIZE_ERROR = 0.01
LAW_SHAPE_ERROR = 0.05
# of the remaining misfit over the removed one that counts as error of the size
LAW_MISFIT_SHARE = 0.6
OCCAM = 1.5  # log evidence that one more parameter costs
NEGLIGIBLE_POWER = 1e-6  # share of the power that is needed: a stop that no hinge reaches
# prior standard deviations beyond which a nuisance parameter is reported: one in twenty moves so by
# chance
MOVED_PRIOR_STD = 2.0
# most probable sets whose evidence held-out conditions must confirm: those of the table
CONFIRMED_SETS = 12
MOST_RIVALS = 12  # hypotheses that are listed


EXCLUDED = "not looked for, as asked"


def select_candidates(effects: Iterable[Effect], without: Collection[str]) -> list[Effect]:
    """The effects without those of these ids. Raises BadInput for an id that is in no catalogue."""
    check_known(without)
    return [effect for effect in effects if effect.id not in without]


def check_known(ids: Collection[str]) -> None:
    """Raises BadInput for an id that is not in the catalogue of legs."""
    _check_among(ids, catalogue())


def check_known_of_any_rig(ids: Collection[str]) -> None:
    """Raises BadInput for an id that is an effect of no leg and of no mechanism."""
    _check_among(ids, {*catalogue(), *(effect.id for effect in MECHANISM)})


def _check_among(ids: Collection[str], known: Collection[str]) -> None:
    unknown = sorted(set(ids) - set(known))
    if unknown:
        raise BadInput(
            f"effect {unknown[0]!r} is not in the catalogue; "
            f"{suggestion(unknown[0], sorted(known))}"
        )


def describe_exclusions(without: Collection[str]) -> tuple[str, ...]:
    """The excluded ids as a remark beside the answer; none where nothing was excluded."""
    if without:
        return (f"{EXCLUDED}: {', '.join(without)}",)
    return ()
