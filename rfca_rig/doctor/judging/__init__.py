"""Evaluation of observations: pure functions from what was seen to findings."""
