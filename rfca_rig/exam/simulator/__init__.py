"""The exam's own simulator of the leg, which shares no code with model, analysis or diagnosis.
Entry point: `experiment`.

1. `world` holds everything that a hidden effect can change.
2. `experiment.simulate` integrates it, one `step` after the other, from `body` and `floor`;
   `compiled` compiles them.
3. `experiment` then makes recorded columns of the forces, with faults and noise.
"""
