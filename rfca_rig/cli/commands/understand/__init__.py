"""Commands that compare recordings with the model: `report`, `fit`, `diagnose`, `crosscheck` and `prove`."""
