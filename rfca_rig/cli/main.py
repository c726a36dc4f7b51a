"""The command line: one app, heavy imports inside the commands, one place that turns errors into
a line and an exit code.
"""

import atexit
import errno
import gc
import logging
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated

import typer
from typer.exceptions import Abort, TyperException

from rfca_rig import __version__
from rfca_rig.cli.commands import (
    calibrate,
    check,
    crosscheck,
    datasets,
    diagnose,
    doctor,
    export,
    fit,
    init,
    predict,
    prove,
    reference,
    report,
    runs,
    setup,
    sweep,
    twin,
)
from rfca_rig.cli.commands.measure import dynamic, fatigue, paper, plan, record, resume, static
from rfca_rig.cli.names import add_completions
from rfca_rig.cli.options import Command, CommandGroup, ProgramGroup
from rfca_rig.cli.terminal import echo, open_null, use_ascii_fallback
from rfca_rig.errors import NO_MORE_PROCESSES, BadInput, RigError, Stopped, Tripped
from rfca_rig.executors.cores import use_one_thread_if_processes_are_few
from rfca_rig.subprocesses import safe_path
from rfca_rig.suggestions import in_one_line

DEBUG_VARIABLE = "RFCA_RIG_DEBUG"
LINK_TO_ITSELF = "Symlink loop from "
# What the system says of a path that somebody wrote, in a file or an option, and that leads
# nowhere.
UNUSABLE_PATHS = (
    errno.ENAMETOOLONG,
    errno.ELOOP,
    errno.EACCES,
    errno.EPERM,
    errno.ENOTDIR,
    errno.EISDIR,
)

app = typer.Typer(
    name="rfca-rig",
    cls=ProgramGroup,
    help=(
        "Run the static and flapping experiments of a flexible leg, on the real rig or on "
        "its twin, and compare them with the model."
    ),
    epilog="First time here? Try: rfca-rig dynamic run --height 215 --speed 2.433",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Plain help: the framed one imports rich with a highlighter and a Markdown parser, two fifths
    # of the time of --help; it also takes [mcap] for markup and leaves it out.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(dynamic.app, name="dynamic", cls=CommandGroup)
app.add_typer(static.app, name="static", cls=CommandGroup)
app.add_typer(fatigue.app, name="fatigue", cls=CommandGroup)
app.add_typer(twin.app, name="twin", cls=CommandGroup)
app.add_typer(calibrate.app, name="calibrate", cls=CommandGroup)
app.add_typer(export.app, name="export", cls=CommandGroup)
app.add_typer(reference.app, name="reference", cls=CommandGroup)
app.add_typer(datasets.app, name="datasets", cls=CommandGroup)
app.add_typer(setup.app, name="setup", cls=CommandGroup)
app.command("init", cls=Command)(init.init)
app.command("import", cls=Command)(export.import_folder)
app.command("resume", cls=Command)(resume.resume)
app.command("recover", cls=Command)(check.recover)
app.command("check", cls=Command)(check.check)
app.command("runs", cls=Command)(runs.runs)
app.command("plan", cls=Command)(plan.plan)
app.command("paper", cls=Command)(paper.paper)
app.command("record", cls=Command)(record.record)
app.command("predict", cls=Command)(predict.predict)
app.command("report", cls=Command)(report.report)
app.command("fit", cls=Command)(fit.fit)
app.command("diagnose", cls=Command)(diagnose.diagnose)
app.command("prove", cls=Command)(prove.prove)
app.command("crosscheck", cls=Command)(crosscheck.crosscheck)
app.command("strip", cls=Command)(predict.strip)
app.command("sweep", cls=Command)(sweep.sweep)
app.command("doctor", cls=Command)(doctor.doctor)
app.command("view", cls=Command)(runs.view)
app.command("contract", cls=Command)(doctor.contract)
app.command("trip", cls=Command)(runs.trip)
app.command("schema", cls=Command)(check.schema)


# Once: tests and notebooks call `run` again and again, and all commands with their options take
# longer than many a command.
_get_command = cache(typer.main.get_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        echo(f"rfca-rig {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and leave."
        ),
    ] = False,
) -> None:
    del version


def run() -> None:
    """Entry point. Exit codes: 0 done, 1 failed, 2 bad input, 3 tripped or changed, 4 worn out, 130
    stopped.
    """
    _prepare_process()
    try:
        # Also for interpreters that a library starts, as MuJoCo's import does.
        with safe_path():
            # The name by which help, messages and the shell's completion call it, also as python -m
            # rfca_rig.
            exit_code = _command()(prog_name="rfca-rig", standalone_mode=False) or 0
        # Here, where a full disk or a closed pipe can still be reported.
        sys.stdout.flush()
        _drop_broken_error_stream()
        sys.exit(exit_code)
    # Exit codes are a contract with scripts: each kind of error has its own.
    except TyperException as error:
        # One line; empty where the help has been printed already, because no command was given.
        text = " ".join(error.format_message().split())
        context = getattr(error, "ctx", None)
        plain = (
            text.replace("Input should be", "should be").replace("Value error, ", "").rstrip(".")
        )
        if text and context is not None:
            plain += f"; see {context.command_path} --help"
        _leave(plain, BadInput.exit_code)
    except Tripped as error:
        _leave(f"{error}; more: rfca-rig trip {error.code}", error.exit_code)
    except RigError as error:
        _leave(str(error), error.exit_code)
    except (KeyboardInterrupt, Abort) as error:
        _leave(*_describe_interruption(error))
    # The reader, for example `head`, has gone. Streams that take all prevent a second error at
    # exit.
    except BrokenPipeError:
        sys.stdout = sys.stderr = open_null()
        sys.exit(1)
    except OSError as error:
        _leave_as_system_refused(error)
        raise
    # Users see one line. The traceback is for developers, who set the variable.
    except Exception as error:
        if os.environ.get(DEBUG_VARIABLE):
            raise
        _leave(*_describe_unexpected(error))


def _prepare_process() -> None:
    # The imports of a command make several hundred thousand objects. The interpreter would look for
    # unused circles among them every 700 new objects, and once more as it ends: together 0.35 s of
    # a run.
    gc.set_threshold(10_000)
    atexit.register(gc.freeze)
    use_ascii_fallback()
    use_one_thread_if_processes_are_few()
    # Set to 0 or below, as by some terminals without a size, help would have no width at all.
    columns = os.environ.get("COLUMNS", "80")
    if not columns.isdecimal() or int(columns) == 0:
        del os.environ["COLUMNS"]
    # python-can warns of every frame that came in two pieces.
    logging.getLogger("can").setLevel(logging.ERROR)
    # Matplotlib warns in two lines of a home in which it cannot write, and works all the same.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def _leave_as_system_refused(error: OSError) -> None:
    """Ends the program; returns only where the traceback is wanted."""
    if error.errno == errno.ENOENT and _is_folder_gone():
        _leave(
            "the folder that you are in has been deleted; change to another one",
            BadInput.exit_code,
        )
    if error.filename and error.errno in UNUSABLE_PATHS:
        _leave(f"{error.filename}: {error.strerror}; give another path", BadInput.exit_code)
    if os.environ.get(DEBUG_VARIABLE):
        return
    # What the output holds is lost; the interpreter would try it again at its end.
    with suppress(OSError):
        sys.stdout.close()
    if error.errno == errno.EAGAIN:
        refused = NO_MORE_PROCESSES
    else:
        file = ""
        if error.filename:
            file = f" ({error.filename})"
        reason = error.strerror or error
        refused = f"the system refused: {reason}{file}; {DEBUG_VARIABLE}=1 shows where"
    _leave(refused, 1)


def _describe_interruption(error: BaseException) -> tuple[str, int]:
    """What to print, and the exit code."""
    # Typer takes every EOFError for ^D at a prompt, also one of a file that ends too early.
    if isinstance(error.__cause__, EOFError):
        return _describe_unexpected(error.__cause__)
    return "stopped by the operator", Stopped.exit_code


def _describe_unexpected(error: Exception) -> tuple[str, int]:
    """What to print, and the exit code."""
    text = " ".join(str(error).split())
    if isinstance(error, RuntimeError) and "start new thread" in text:
        return NO_MORE_PROCESSES, 1
    # How Path.resolve says it before Python 3.13, as no OSError.
    if isinstance(error, RuntimeError) and text.startswith(LINK_TO_ITSELF):
        path = text.removeprefix(LINK_TO_ITSELF).strip("'")
        return f"{path}: {os.strerror(errno.ELOOP)}; give another path", BadInput.exit_code
    # A damaged environment, for example a system library that OpenCV needs; a name that is missing
    # here is a mistake of ours.
    if isinstance(error, ImportError) and not (error.name or "").startswith("rfca_rig"):
        return f"a library cannot be loaded: {text}; install rfca-rig again in a new environment", 1
    return (
        (
            f"this is a mistake in rfca-rig, not yours: {type(error).__name__}: {text}; "
            f"{DEBUG_VARIABLE}=1 shows where"
        ),
        1,
    )


def _command() -> Callable[..., int | None]:
    """The app as one command, with its shell completions where a shell asks for them."""
    command = _get_command(app)
    add_completions(command)
    return command


def _is_folder_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _leave(message: str, exit_code: int) -> None:
    # The exit code still tells where the error stream takes nothing.
    with suppress(OSError):
        if message:
            echo(f"rfca-rig: {in_one_line(message)}", err=True)
    _drop_broken_error_stream()
    sys.exit(exit_code)


def _drop_broken_error_stream() -> None:
    """Replaces an error stream that takes nothing: the interpreter would try it again at its
    end, and end with code 120.
    """
    try:
        sys.stderr.flush()
    except (OSError, ValueError):
        sys.stderr = open_null()
