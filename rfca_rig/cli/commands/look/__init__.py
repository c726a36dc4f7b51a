"""Commands that look at what was measured: `runs`, `view` and `trip`."""
