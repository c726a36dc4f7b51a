"""Analysis of recordings: phases and valleys of strokes, compared with the model's. Entry point:
`compare.compare_condition`.

1. `repeats` groups strokes by condition, `phases` finds their events.
2. `matched_simulation` simulates the same stroke, `compare` gives the differences and Table II,
   `peak_force` those at the peak.
3. `fitting` fits nominal values, `torque_rotation` the curve of the hinges; `swings` serves
   pendulums.
4. `crosscheck` compares the model with MuJoCo; `prediction`, `strips` and `tip_load` predict
   without a recording.
"""
