"""The experiment that would separate the open hypotheses. Entry points: `leg_experiment`, `pendulum_experiment`, `mechanism_experiment`.

`open_hypotheses` lists what is open, `expected_information` computes what an experiment would show, `choice` ranks experiments and bench
tests, and `next_protocol` writes the proposal as a protocol file.
"""
