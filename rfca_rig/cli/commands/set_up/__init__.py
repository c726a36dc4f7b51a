"""Commands that set up a rig: `doctor`, `calibrate`, `contract` and `twin`."""
