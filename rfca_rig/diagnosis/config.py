"""The constants of the search, in one place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchConfig:
    """How widely hypotheses are searched. All are counts of fits or shares; each trades simulations against missed explanations.

    Parameters
    ----------
    coarse_conditions
        Dynamic conditions of the subset on which starts are screened and first fitted. Four corners of a 3 x 3 grid of heights and speeds
        rank effects as all nine do.
    starts_per_effect
        Grid points from which one effect is fitted: the best beside the fit without effects, and the best beside the nominal model.
    singles_coarse, pairs_coarse, triples_coarse
        Sets of each size that are fitted on the subset.
    singles_full, pairs_full, triples_full
        Sets of each size that go on to all conditions.
    parents
        Fits beside which partners are screened anew, by what each partner would do to a model that has the first effect already.
    partners
        Partners fitted beside each parent.
    converged
        Fits of each size that are brought to their MAP with fresh Jacobians.
    worth_a_fit
        Chi-square that an effect must promise to remove, or it is not fitted: less cannot pay for its parameters (Occam factor of about 3
        in log evidence each).
    worth_beside_a_good_fit
        The same beside an explanation that is adequate already: what a law that is off by some percent leaves.
    worth_a_probe
        Share of these that an effect must promise by its signature beside the nominal model, or it is not screened beside a parent.
    """

    coarse_conditions: int = 4
    starts_per_effect: tuple[int, int] = (2, 1)
    singles_coarse: int = 12
    pairs_coarse: int = 10
    triples_coarse: int = 5
    singles_full: int = 6
    pairs_full: int = 4
    triples_full: int = 2
    parents: int = 2
    partners: int = 5
    converged: int = 2
    worth_a_fit: float = 6.0
    worth_beside_a_good_fit: float = 60.0
    worth_a_probe: float = 0.3


DEFAULT_SEARCH = SearchConfig()
