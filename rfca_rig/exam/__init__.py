"""Blind benchmark of the diagnosis: cases with hidden effects from an independent simulator. Entry
point: `examine.examine`.

1. `cases` draws the hidden effects (`sampled_rig`, `hidden_laws`); `truth` is sealed before the
   first campaign is written.
2. `simulator` simulates them, with laws that differ from the model's; `simulate_campaign` and
   `pendulums` write campaigns.
3. `answer` reads a diagnosis; `scoring` compares it with the truth, `scored` counts, `calibrate`
   fits probabilities to the results.
"""
