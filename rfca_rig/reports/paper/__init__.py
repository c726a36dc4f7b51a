"""The page on section IV of the paper, reproduced for one leg. Entry point: `page.write_paper`.

`tables` has Table I, Table II and the predicted valleys; `pictures` has Fig. 7 (a) to (f) and their
numbers as CSV; `page` puts them on a page with the commands of all steps.
"""
