"""Hinges that lose stiffness with every stroke."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    """The mean factor over the strokes whose mean is simulated; that of the first stroke where they were not counted."""
    decades = np.log10(1.0 + np.array(setup.strokes_before or (0,)))
    factor = float(np.mean((1.0 - values["loss_per_decade_relative"]) ** decades))

    def soften(chain: Chain) -> Chain:
        return chain._replace(k0=factor * chain.k0)

    return with_chain(setup, soften)


EFFECT = Effect(
    id="stiffness_fading",
    where="hinges",
    left_out="the hinges lose stiffness from stroke to stroke",
    law="k0 (1 - loss)^lg(1 + n) in all hinges, n strokes before in the campaign",
    source="cyclic softening in proportion to the logarithm of the cycles",
    parameters=(Parameter("loss_per_decade_relative", 0.005, 0.2, below=1.0),),
    apply=apply,
    needs_order=True,
)
