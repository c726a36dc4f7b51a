"""The commands of `rfca-rig --help`, each in a module of its name or of a related command; those that measure are in `measure`.

`contract` stands in `doctor`, `schema` in `check`, `import` in `export`, `strip` in `predict`, `view` and `trip` in `runs`.
`cli.options.GROUPS` has their panels and order in the help.
"""
