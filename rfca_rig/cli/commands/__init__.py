"""The commands, each in a module of its name or of a related command. Entry point: `cli.main`."""
