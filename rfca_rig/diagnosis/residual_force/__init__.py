"""Residual force: what acts where no entry of the catalogue fits. Entry points:
`mismatch_map.locate_mismatch`, `free_form.free_form`, `stated_law.measure_stated_law`.

`mismatch_map` says in which signal, phase and condition model and recordings differ. `force_inputs`
and `spline_force` apply a free force at each place, `force_localization` finds the place, and
`sparse_law` looks for a short formula. `measured_law` estimates a force as a function of one
argument, with `law_arguments` and `law_memory`.
"""
