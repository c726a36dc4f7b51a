"""Between a printed plan and real motion: a person who confirms, and a drive that has shown that it stops by itself."""

import typer

from rfca_rig.cli.run_config import RunConfig
from rfca_rig.cli.terminal import marked
from rfca_rig.engine.arming import prove_stop
from rfca_rig.engine.bench import Bench
from rfca_rig.errors import BadInput

CHECKLIST = "Emergency stop tested today? Guard closed? Nobody near the leg?"


def ask_operator(config: RunConfig) -> None:
    """Real hardware moves only after the operator has typed the force limit; nothing is assumed from a pressed key."""
    limit = f"{config.plan.limits.force_N:g}"
    typer.echo(f"REAL the motor will turn. {CHECKLIST}", err=True)
    if typer.prompt("REAL type the force limit in newtons to go on", default="", show_default=False, err=True).strip() != limit:
        raise BadInput(f"not armed: the force limit is {limit} N; nothing has moved")


def prove_drive(config: RunConfig, bench: Bench) -> dict[str, str | float]:
    """What the arming showed, for the run's events: what was asked and answered, and the drive's own stop."""
    watchdog_s = prove_stop(bench)
    is_guarded = bench.motor.identity().get("guardian", "none") != "none"
    who = "the guardian lets go of the motor" if is_guarded else "the drive's watchdog stops the motor"
    marked(config.mark, config.quiet)(f"{who} after {watchdog_s:.2f} s of silence")
    return {"confirmed": CHECKLIST, "by_typing_N": config.plan.limits.force_N, "watchdog_s": round(watchdog_s, 3)}
