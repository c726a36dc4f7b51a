"""diagnosis.html and diagnosis.json, the omitted physics. Entry point: `files`, through `page`
with its `tables` and `pictures`.
"""
