"""Laws of the package are compiled once for all processes, each for itself, and again where a
file of the model changes.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rfca_rig.model.effects import hinge_stiffness, spring_memory
from rfca_rig.model.kernel import laws

CALL_BOTH = """
import ctypes
from rfca_rig.model.effects.hinge_stiffness import hinge_backlash_torque, hinge_stop_torque
from rfca_rig.model.kernel.laws import HINGE, address_of

Numbers = ctypes.c_double * 8
def torque(law, *parameters):
    out = Numbers()
    call = ctypes.CFUNCTYPE(None, *[ctypes.POINTER(ctypes.c_double)] * 4)(address_of(law, HINGE))
    call(Numbers(0.5, 0.0, 0.0, 10.0, 0.0), Numbers(), Numbers(*parameters), out)
    return out[0]

print(torque(hinge_backlash_torque, 0.1), torque(hinge_stop_torque, 0.3, 40.0, 1.0))
"""


def call_both(cache: Path) -> str:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", CALL_BOTH],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout


def compiled_laws(cache: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc") if "laws" in path.parts}


@pytest.mark.slow
def test_a_second_process_takes_over_what_the_first_compiled_and_does_not_mix_the_laws_up(tmp_path):
    first = call_both(tmp_path)
    backlash, stop = map(float, first.split())
    assert (backlash, stop) == (pytest.approx(-1.0), pytest.approx(8.0))
    kept = compiled_laws(tmp_path)
    assert len(kept) == 2
    assert call_both(tmp_path) == first
    assert compiled_laws(tmp_path) == kept


def test_a_law_is_kept_under_its_own_name_and_the_source_of_all(monkeypatch):
    keys = {
        laws._key_of(law)
        for law in (
            hinge_stiffness.hinge_stop_torque,
            spring_memory.spring_relaxation_torque,
            spring_memory.spring_relaxation_advance,
        )
    }
    assert len(keys) == 3
    monkeypatch.setattr(laws, "_source_of_laws", lambda: "another edition")
    assert laws._key_of(hinge_stiffness.hinge_stop_torque) not in keys


def test_a_lab_s_own_law_is_compiled_in_every_process(monkeypatch):
    def law(phi, rate, elapsed, k0, k2, memory, parameter):
        return 2.0 * phi, 2.0, 0.0

    monkeypatch.setattr(laws, "_key_of", lambda _: pytest.fail("no folder for it"))
    assert law.__module__.startswith("tests")
    assert laws.address_of(law, laws.HINGE) != 0
