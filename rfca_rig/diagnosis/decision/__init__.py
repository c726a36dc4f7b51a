"""From weighted hypotheses to a verdict. Entry point: `decide.decide`.

`acceptance` tests the best hypothesis, `negative_controls` compares it with fake effects, `detection_limits` says what else would have
been seen.
"""
