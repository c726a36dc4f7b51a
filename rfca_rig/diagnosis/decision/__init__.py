"""From the hypotheses of a search to a graded answer. Entry point: `decide.decide`.

`comparison` ranks all sets of effects with the discrepancy scale free and measures the support of
each effect. `calibration` turns support into probabilities. `sizes` gives sizes with intervals, and
the sizes that the recordings exclude. `wording` puts the answer into words.
"""
