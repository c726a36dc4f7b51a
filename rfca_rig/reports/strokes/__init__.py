"""report.html, strokes and motions over the model. Entry points: `page.write_report` and, for
pendulums and mechanisms, `motions`.

1. `page.compare_sources` compares each recording with its model.
2. `tables` and `overlay` make tables and figures of it, `page.page` the page.
"""
