"""Fits parameters of the nominal model to recordings. Entry points: `strokes.fit_recordings` and
`strokes.fit_valleys`.

1. `space` holds `parameters` with their priors.
2. `residuals` compares strokes with simulations, `scatter` keeps differences between strokes apart.
3. `fit` searches; `result` holds what it found, and writes it as a model file.
"""
