"""The mechanics of the leg; knows nothing of hardware. Entry points:
`stroke.simulate_stroke_at_speed` and `stroke.simulate_stroke`.

1. `parameters` holds a rig; `catalogue.set_up` puts the `effects` into its `setup`. What an effect
   is, whichever simulator has its law, stands in `declarations`.
2. `chain` puts the numbers of a leg into the compiled equations of `kernel`, which carries it
   through a stroke.
3. `stroke` simulates one stroke, or many with legs `side_by_side`.
4. `static_stages` simulates static stages in time, `statics_contact` follows their equilibria.

`paper` computes the paper's equations as they are written.
"""
