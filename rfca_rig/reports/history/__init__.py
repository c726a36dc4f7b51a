"""The page with the history of a rig: how its values have changed since the reference, run by run.

Entry point: `page.write_history`, which writes history.html, history.csv and history.json.
"""
