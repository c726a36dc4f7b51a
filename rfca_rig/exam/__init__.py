"""A blind exam of the diagnosis: cases with concealed physics, made by a simulator of its own. Entry point: `examine.examine`.

1. `cases` draws what is concealed (`injected_faults`, `unknown_faults`); `truth` is sealed before the first campaign is written.
2. `world` and the `engine_...` modules simulate it, with laws that differ from the model's; `simulate_campaign` writes it as a lab would.
3. `answer` is what the diagnosis said; `scoring` compares it with the truth, `scored` counts, `calibrate` fits probabilities to it.
"""
