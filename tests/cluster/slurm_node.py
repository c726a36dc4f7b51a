"""A real SLURM of one node, all of it in one folder and gone with its block.

Run: python -m tests.cluster.slurm_node FOLDER

Needs Debian's packages (apt-get install --no-install-recommends slurm-wlm munge), no root, and
nothing of /etc. As a program it runs until ^C; in another terminal `export
SLURM_CONF=FOLDER/slurm.conf`, then sbatch, squeue and `rfca-rig ... --cluster slurm:FILE` meet it.
"""

import getpass
import os
import platform
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import which

DAEMONS = ("munged", "slurmctld", "slurmd")
WITHIN_S = 30.0
CPUS = 4  # as the node says it has: it may promise more than there are
PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"

CONF = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={port}
SlurmdPort={node_port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
ReturnToService=2
SlurmctldParameters=enable_configless
SlurmdParameters=config_overrides
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=16000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str | None:
    """Which program is not installed, in words for a reason; None where all are."""
    lacking = [
        name
        for name in (*DAEMONS, "sbatch", "scancel", "squeue", "sinfo")
        if which(name, path=PATH) is None
    ]
    if lacking:
        return f"not installed: {', '.join(lacking)} (Debian: slurm-wlm, munge)"
    return None


@contextmanager
def slurm_node(folder: Path) -> Iterator[None]:
    """SLURM_CONF is set within the block. Raises RuntimeError where the daemons do not come up."""
    folder = folder.resolve()
    (folder / "state").mkdir(parents=True)
    (folder / "spool").mkdir()
    first_port = 20000 + secrets.randbelow(20000)
    conf = CONF.format(
        host=platform.node(),
        user=getpass.getuser(),
        folder=folder,
        port=first_port,
        node_port=first_port + 1,
        cpus=CPUS,
    )
    (folder / "slurm.conf").write_text(conf)
    (folder / "munge.key").write_bytes(secrets.token_bytes(1024))
    (folder / "munge.key").chmod(0o600)
    before = os.environ.get("SLURM_CONF")
    with ExitStack() as stack:
        try:
            os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
            stack.enter_context(
                _daemon(folder, "munged", "--foreground", "--force", *_munge_files(folder))
            )
            _until((folder / "munge.socket").exists, folder)
            stack.enter_context(_daemon(folder, "slurmctld", "-D"))
            stack.enter_context(_daemon(folder, "slurmd", "-D"))
            _until(_is_idle, folder)
            yield
        finally:
            os.environ.pop("SLURM_CONF")
            if before is not None:
                os.environ["SLURM_CONF"] = before


def _munge_files(folder: Path) -> list[str]:
    files = {
        "key-file": "munge.key",
        "socket": "munge.socket",
        "pid-file": "munge.pid",
        "log-file": "munge.log",
        "seed-file": "munge.seed",
    }
    return [f"--{option}={folder / name}" for option, name in files.items()]


@contextmanager
def _daemon(folder: Path, name: str, *words: str) -> Iterator[None]:
    program = which(name, path=PATH)
    assert program is not None
    with (folder / f"{name}.out").open("wb") as said:
        process = subprocess.Popen(
            [program, *words],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
            start_new_session=True,
        )
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _is_idle() -> bool:
    said = subprocess.run(
        ["sinfo", "--noheader", "--format=%T"], capture_output=True, text=True, check=False
    )
    return said.stdout.strip() in ("idle", "mixed", "allocated")


def _until(is_so: Callable[[], bool], folder: Path) -> None:
    until = time.monotonic() + WITHIN_S
    while not is_so():
        if time.monotonic() > until:
            lines = [
                line
                for log in sorted(folder.glob("*.log"))
                for line in log.read_text(errors="replace").splitlines()[-3:]
            ]
            raise RuntimeError("SLURM does not come up: " + "; ".join(lines))
        time.sleep(0.1)


def main() -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if (lacking := missing()) is not None:
        sys.exit(lacking)
    with slurm_node(Path(sys.argv[1])):
        print(f"export SLURM_CONF={Path(sys.argv[1]).resolve() / 'slurm.conf'}", flush=True)
        try:
            signal.pause()
        except KeyboardInterrupt:
            print("stopping")


if __name__ == "__main__":
    main()
