"""Diagnosis of the physics that a model lacks: effects with probability and size, and the
experiment that separates what is still open.

Entry point: `diagnose.diagnose`. It takes a `problem.Problem`, which `opening.open_problem` makes
of recordings: of a leg (`leg`) or of what MuJoCo simulates (`mechanisms`). The steps are the same
for all rigs, one module or sub-package each:

1. `data`: recordings become vectors of observations, condition by condition, and a simulator
   predicts the same.
2. `likelihood`: the covariance of noise, repeat scatter and model discrepancy; Laplace
   approximation; cross-validation.
3. `inference`: MAP fits of hypotheses (sets of effects), and the search over them.
4. `decision`: comparison of all sets of effects, calibrated probabilities, sizes, detection limits,
   and the graded answer.
5. `residual_force`: where and in which form an effect outside the catalogue acts.
6. `experiment_design`: the experiment that separates the hypotheses that remain open.

`simulator` is the interface through which steps 1 to 4 see a rig, and `problem` is the one through
which the commands see it. `leg` and `mechanisms` implement both; only `opening` chooses.

`result.Diagnosis` is the answer as plain values, which the report, the JSON file and the terminal
read.
"""
