"""The experiment that would separate the open hypotheses. Entry points: `leg_experiment`,
`mechanism_experiment`.

`choice` lists what is open, computes what an experiment would show, and ranks experiments and bench
tests. Experiments on a pendulum are designed beside its diagnosis.
"""
