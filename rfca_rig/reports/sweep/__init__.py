"""sweep.html, a parameter sweep. Entry point: `page`; `pictures` selects figures and words, and
draws.
"""
