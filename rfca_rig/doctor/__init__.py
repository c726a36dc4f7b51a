"""Which devices are there, in what state, and what is to be done: looking and judging apart."""
