"""Plain help: commands in groups by the work they are for, each summary whole, no types of Python.

Rich would do the groups, at two fifths more time of every --help.
"""

from typing import Any

from typer.core import TyperCommand, TyperGroup

# Every command stands in one group; the order is that of the help.
GROUPS = {
    "Measure": ("plan", "dynamic", "static", "fatigue", "resume"),
    "Look": ("runs", "view", "trip"),
    "Understand": ("report", "fit", "diagnose", "crosscheck", "prove"),
    "Design": ("predict", "strip", "sweep"),
    "Set up": ("doctor", "calibrate", "contract", "twin"),
    "Files": ("init", "import", "export", "check", "recover", "schema"),
}


class Command(TyperCommand):
    """A command whose arguments are named by their metavar alone."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        # Braces around a required argument are in no other program's usage line.
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        for title, kind in (("Arguments", "argument"), ("Options", "option")):
            records = [one.get_help_record(ctx) for one in self.get_params(ctx) if one.param_type_name == kind]
            # Behind an argument's name stands its type, as in "RUN <path>".
            rows = [(name.partition(" <")[0], text) for name, text in filter(None, records)]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


class CommandGroup(TyperGroup):
    """A group whose help shows the whole summary of each command, where plain help would cut it after half a line."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        self._write_section(formatter, "Commands", self.commands)

    def _write_section(self, formatter: Any, title: str, names: Any) -> None:
        with formatter.section(title):
            formatter.write_dl([(name, self.commands[name].get_short_help_str(limit=1000)) for name in names])


class ProgramGroup(CommandGroup):
    """The program itself, with its commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        for title, names in GROUPS.items():
            self._write_section(formatter, title, names)
