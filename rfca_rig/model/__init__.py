"""The mechanics of the leg; knows nothing of hardware. Entry points: `stroke.simulate_stroke_at_speed` and `stroke.simulate_stroke`.

1. `parameters` holds a rig; `setup.set_up` puts the effects of the `catalogue` into it.
2. `chain` is the compiled chain of links with its `forces`, `contact` and `laws`.
3. `integrator` carries it through a stroke; `samples` are the states asked for.
4. `statics` has equilibria, for static stages and for fits of the torque-rotation curve.

`elastica`, `newton_euler`, `constrained_contact` and others compute the paper's equations as they are written.
"""
