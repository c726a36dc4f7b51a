"""The commands, in a package per panel of `rfca-rig --help`, each in a module of its name or of a related command.

Panels: `measure`, `look`, `understand`, `design`, `set_up`, `files`. `cli.options.GROUPS` has their order in the help.
"""
