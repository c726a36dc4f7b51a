"""The command line: one app, heavy imports inside the commands, one place that turns errors into a line and an exit code."""

import logging
import os
import sys
from collections.abc import Callable
from typing import Annotated

import typer
from typer.exceptions import Abort, TyperException

from rfca_rig import __version__
from rfca_rig.cli import (
    calibrating,
    checking,
    contracting,
    crosscheck,
    diagnosing,
    doctoring,
    drafting,
    dynamic,
    explaining,
    exporting,
    fatigue,
    fitting,
    importing,
    listing,
    planning,
    predicting,
    proving,
    recovering,
    reporting,
    resuming,
    serving,
    static,
    strip,
    sweeping,
    viewing,
)
from rfca_rig.cli.completion import add_completions
from rfca_rig.cli.streams import make_safe
from rfca_rig.errors import BadInput, RigError, Stopped, Tripped

DEBUG_VARIABLE = "RFCA_RIG_DEBUG"

app = typer.Typer(
    name="rfca-rig",
    help="Run the static and flapping experiments of a flexible leg, on the real rig or on its twin, and compare them with the model.",
    epilog="First time here? Try: rfca-rig dynamic run --height 215 --speed 2.433",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(dynamic.app, name="dynamic")
app.add_typer(static.app, name="static")
app.add_typer(fatigue.app, name="fatigue")
app.add_typer(serving.app, name="twin")
app.add_typer(calibrating.app, name="calibrate")
app.add_typer(exporting.app, name="export")
app.command("init")(drafting.init)
app.command("import")(importing.import_folder)
app.command("resume")(resuming.resume)
app.command("recover")(recovering.recover)
app.command("check")(checking.check)
app.command("runs")(listing.runs)
app.command("plan")(planning.plan)
app.command("predict")(predicting.predict)
app.command("report")(reporting.report)
app.command("fit")(fitting.fit)
app.command("diagnose")(diagnosing.diagnose)
app.command("prove")(proving.prove)
app.command("crosscheck")(crosscheck.crosscheck)
app.command("strip")(strip.strip)
app.command("sweep")(sweeping.sweep)
app.command("doctor")(doctoring.doctor)
app.command("view")(viewing.view)
app.command("contract")(contracting.contract)
app.command("trip")(explaining.trip)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rfca-rig {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    del version


def run() -> None:
    """Entry point. Exit codes: 0 done, 1 failed, 2 bad input, 3 tripped, 4 worn out, 130 stopped."""
    make_safe()
    logging.getLogger("can").setLevel(logging.ERROR)  # python-can warns of every frame that came in two pieces
    try:
        sys.exit(_command()(standalone_mode=False) or 0)
    except TyperException as error:
        _leave(_usage_text(error), BadInput.exit_code)
    except Tripped as error:
        _leave(f"{error}; more: rfca-rig trip {error.code}", error.exit_code)
    except RigError as error:
        _leave(str(error), error.exit_code)
    except (KeyboardInterrupt, Abort):
        _leave("stopped by the operator", Stopped.exit_code)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except Exception as error:
        if os.environ.get(DEBUG_VARIABLE):
            raise
        said = " ".join(f"{type(error).__name__}: {error}".split())
        _leave(f"this is a mistake in rfca-rig, not yours: {said}; {DEBUG_VARIABLE}=1 shows where", 1)


def _command() -> Callable[..., int | None]:
    """The app as one command, with what the shell may offer."""
    command = typer.main.get_command(app)
    add_completions(command)
    return command


def _usage_text(error: TyperException) -> str:
    """One line; empty where the help has been printed already, because nothing was asked for."""
    said = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    plain = said.replace("Input should be", "should be").replace("Value error, ", "").rstrip(".")
    return f"{plain}; see {context.command_path} --help" if said and context is not None else plain


def _leave(message: str, exit_code: int) -> None:
    if message:
        typer.echo(f"rfca-rig: {message}", err=True)
    sys.exit(exit_code)
