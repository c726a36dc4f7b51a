"""Commands that measure: `plan`, `dynamic`, `static` with its `static report`, `fatigue`,
`record` and `resume`.
"""
