"""Blind benchmark of the diagnosis: cases with hidden effects from an independent simulator. Entry point: `examine.examine`.

1. `cases` draws the hidden effects (`injected_faults`, `unknown_faults`); `truth` is sealed before the first campaign is written.
2. `world` and the `engine_...` modules simulate them, with laws that differ from the model's; `simulate_campaign` writes campaigns.
3. `answer` reads a diagnosis; `scoring` compares it with the truth, `scored` counts, `calibrate` fits probabilities to the results.
"""
