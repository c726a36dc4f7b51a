"""sweep.html, a parameter sweep. Entry point: `page`; `views` selects figures and words, `pictures` draws."""
