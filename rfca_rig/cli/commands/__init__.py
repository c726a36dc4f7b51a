"""The commands of `rfca-rig --help`, each in a module of its name; those that measure are in the
package `measure`, those of the first day in `setup`.

Related commands share a module: `contract` in `doctor`, `recover` in `check`, `schema` in `check`,
`import` in `export`, `strip` in `predict`, `view` in `runs`, `trip` in `runs`. `cli.options.GROUPS`
has their panels and order in the help.
"""
