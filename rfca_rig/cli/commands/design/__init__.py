"""Commands for design, which need no rig: `predict` and `strip`, both in `predict`, and `sweep`."""
