"""Effects of mass in another place than in the nominal model."""

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.model.declarations import rig as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.setup import Setup, with_chain

# A point mass at the end of the last link.


def add_tip_mass(setup: Setup, mass_kg: float) -> Setup:
    """The setup with the mass on the tip: it acts at the far end of every link."""

    def load(chain: Chain) -> Chain:
        return chain._replace(
            moment=chain.moment + mass_kg * np.outer(chain.length, chain.length),
            first_moment=chain.first_moment + mass_kg * chain.length,
            total_mass=chain.total_mass + mass_kg,
        )

    return with_chain(setup, load)


def apply_tip_mass(setup: Setup, values: Values) -> Setup:
    return add_tip_mass(setup, 1e-3 * values["mass_g"])


TIP_MASS = declared.TIP_MASS.make_effect(
    parameters=(Parameter("mass_g", 0.5, 100.0),),
    apply=apply_tip_mass,
)


# One link that is heavier (or lighter) than the others.


def apply_heavier_link(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a link that the leg does not have."""
    leg = setup.rig.leg
    last = len(leg.link_masses_kg)
    if not 0.5 <= values["link"] < last + 0.5:
        raise BadInput(
            f"effect {declared.HEAVIER_LINK.id}: link {values['link']:g} is not there; "
            f"this leg has links 1 to {last}"
        )
    link = round(values["link"]) - 1
    more_kg = (values["mass_factor"] - 1.0) * leg.link_masses_kg[link]
    length_m = leg.link_lengths_m[link]

    def load(chain: Chain) -> Chain:
        # A uniform rod: it acts at the far ends of the links before it, and at its own middle.
        reach = np.where(np.arange(last) < link, chain.length, 0.0)
        reach[link] = 0.5 * length_m
        moment = chain.moment + more_kg * np.outer(reach, reach)
        moment[link, link] += more_kg * length_m**2 / 12.0
        return chain._replace(
            moment=moment,
            first_moment=chain.first_moment + more_kg * reach,
            total_mass=chain.total_mass + more_kg,
        )

    return with_chain(setup, load)


HEAVIER_LINK = declared.HEAVIER_LINK.make_effect(
    parameters=(
        Parameter("link", 1.0, 7.0, whole=True),
        Parameter("mass_factor", 0.5, 4.0),
    ),
    apply=apply_heavier_link,
)


EFFECTS = (
    TIP_MASS,
    HEAVIER_LINK,
)
