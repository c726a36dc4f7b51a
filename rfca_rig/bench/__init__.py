"""Composes a rig from its parts and stores what it measures. Entry point: `factory.open_bench`.

`factory` and `sensors` make drivers from a rig file; twins get `leg_plant`, a simulated leg,
`concealment`, an effect that its nominal model lacks, and `fault_injection`. `expectation` predicts
the loads of a plan, `recorder` turns what the engine measured into recordings, `resume` continues a
stopped run, `rig_compatibility` compares the present rig with that of the run.
"""
