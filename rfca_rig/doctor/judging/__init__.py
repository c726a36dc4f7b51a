"""Each check a pure function from what was seen to findings."""
