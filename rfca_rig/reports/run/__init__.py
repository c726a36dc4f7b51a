"""run.html, how a run went. Entry point: `page.page`, from the `parts` of the run, its `tables`
and its `pictures`.
"""
