"""From the hypotheses of a search to a graded answer. Entry point: `decide.decide`.

1. `comparison` ranks all sets of effects with the discrepancy scale free and measures the support
   of each effect.
2. `calibration` turns support into probabilities, and `families` collects those of effects and of
   their families.
3. `criteria` says what a hypothesis must meet; `table` has the probabilities of all sets.
4. `decide` makes of them a `decision.Decision`. `joined` makes one of two, for forces and shaft.
5. `sizes` gives sizes with intervals, and the sizes that the recordings exclude.
"""
