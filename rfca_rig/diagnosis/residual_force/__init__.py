"""What acts where no catalogue entry fits. Entry points: `mismatch_map.locate_mismatch`, `free_form.free_form`.

`mismatch_map` says in which signal, phase and condition model and recordings differ; `force_inputs` and `spline_force` put a free force
at each place; `force_localization` finds the place; `terms` and `sparse_law` look for its law.
"""
