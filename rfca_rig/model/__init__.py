"""The mechanics of the leg; knows nothing of hardware. Entry points: `stroke.simulate_stroke_at_speed` and `stroke.simulate_stroke`.

1. `parameters` holds a rig; `catalogue.set_up` puts the `effects` into its `setup`.
2. `chain` is the compiled chain of links with its `forces`, `contact` and `laws`.
3. `integrator` carries it through a stroke, stage by stage, and fills the samples asked for.
4. `static_stages` simulates static stages in time, `statics_contact` follows their equilibria.

`paper` computes the paper's equations as they are written.
"""
