"""Torque-rotation curve of the hinges from static stages. Entry point: `evaluate.evaluate`.

1. `stages` holds the measured values and the errors common to many stages, `balance` their
   conditions.
2. `recovery` fits a curve of one of the forms in `bases`, by `gauss_helmert`.
3. `checks` tests its assumptions; `static_result` and `calibration_file` state the result.
"""
