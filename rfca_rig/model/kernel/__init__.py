"""The compiled equations of motion of a chain of links, for one leg or for eight side by side.
Entry: `integrator.integrate`.

1. `state` names the arrays; `compiled` compiles functions, `lanes` are the numbers of eight legs.
2. `forces` assembles residual and Jacobian, with `contact`, `bump` and the `laws` of effects.
3. `stage` solves one stage of a step by Newton's iteration, `integrator` takes the steps and fills
   the samples.
"""
