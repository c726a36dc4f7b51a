"""static.html, the torque-rotation curve and the static stages. Entry point: `files`, from
`tables` and `pictures` through `page`.
"""
