"""Runs the static and flapping experiments of a flexible leg, and compares them with a
rigid-flexible multibody model.

As a library: `import rfca_rig as rr`. The names of `__all__` are stable; they are imported when
they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rfca_rig import mechanics as mechanics
    from rfca_rig.notebook.analyses import diagnose as diagnose
    from rfca_rig.notebook.analyses import effects as effects
    from rfca_rig.notebook.analyses import fit as fit
    from rfca_rig.notebook.analyses import report as report
    from rfca_rig.notebook.experiments import plan as plan
    from rfca_rig.notebook.experiments import run as run
    from rfca_rig.notebook.recordings import open_path as open
    from rfca_rig.notebook.rig import Rig as Rig
    from rfca_rig.notebook.rig import simulate as simulate
    from rfca_rig.notebook.runs import runs as runs
    from rfca_rig.public_data import library as datasets

__version__ = "0.1.0"
# Modules of the public names; a name of its own there after the colon.
_PLACES = {
    "Rig": "rfca_rig.notebook.rig",
    "datasets": "rfca_rig.public_data.library:",
    "diagnose": "rfca_rig.notebook.analyses",
    "effects": "rfca_rig.notebook.analyses",
    "fit": "rfca_rig.notebook.analyses",
    "mechanics": "rfca_rig.mechanics:",
    "open": "rfca_rig.notebook.recordings:open_path",
    "plan": "rfca_rig.notebook.experiments",
    "report": "rfca_rig.notebook.analyses",
    "run": "rfca_rig.notebook.experiments",
    "runs": "rfca_rig.notebook.runs",
    "simulate": "rfca_rig.notebook.rig",
}
__all__ = [
    "Rig",
    "datasets",
    "diagnose",
    "effects",
    "fit",
    "mechanics",
    "open",
    "plan",
    "report",
    "run",
    "runs",
    "simulate",
]


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module rfca_rig has no name {name!r}; it has {', '.join(__all__)}")
    module, _, attribute = _PLACES[name].partition(":")
    loaded_module = import_module(module)
    if _PLACES[name].endswith(":"):
        return loaded_module
    return getattr(loaded_module, attribute or name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
