"""The experiment that would decide between open hypotheses. Entry point: `next_experiment.next_experiment`.

`open_hypotheses` says what is open; `designs` and `feasible_region` what can be run; `expected_information` what it would tell;
`next_protocol` writes it as a protocol; `bench_tests` are tests off the rig.
"""
