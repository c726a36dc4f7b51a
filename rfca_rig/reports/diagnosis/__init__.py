"""diagnosis.html and diagnosis.json, the omitted physics. Entry point: `files`.

`page` has the list of sections, and those that need no module of their own: `opening`, `left_out`,
`residual_map` and `omitted_physics` do. Their numbers and figures are in `tables` and `pictures`.
"""
