"""The experiment that would separate the open hypotheses. Entry points: `leg_experiment`, `pendulum_experiment`, `mechanism_experiment`.

`open_hypotheses` lists what is open. `choice` computes what an experiment would show, and ranks experiments and bench tests.
"""
