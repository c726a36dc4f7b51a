"""Reports that compare recordings with the model: a page for people, tables for programs and
papers.

Entry point: `strokes.page.write_report`. One package per page, in the order of the work:

1. `run` tells how a run went.
2. `strokes` has Table II, the forces at the peak, and every stroke over the model; `motions` in it
   the pendulums and mechanisms.
3. `static` has the torque-rotation curve, `sweep` a parameter sweep.
4. `diagnosis` has the omitted physics, `exam` the blind benchmark.

A page is a list of `sections`, each made by one function of text (`elements`, `text`), tables
(`html_table`, from `table`) and figures (`style`). `templates.render_page` builds the list into one
file. `provenance` states where a page comes from.
"""
