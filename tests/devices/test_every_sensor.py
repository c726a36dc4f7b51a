"""Every force sensor that the registry knows: a folder that is added is tested here without a
further line.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rfca_rig
from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices import FORCE_SENSORS, OWN, find_sensor, load_object
from rfca_rig.devices.sections import ForceSensorSection
from rfca_rig.toml import validate
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twins.world import ShaftDrive

ROOT = Path(rfca_rig.__file__).parents[1]
KINDS = [kind for kind in FORCE_SENSORS if kind != OWN]
PARTS = ("section", "driver", "open", "twin", "wire", "check", "find")


def example_of(kind: str) -> ForceSensorSection:
    make = find_sensor(kind)
    keys = validate({"device": kind, **make.example}, load_object(make.section), kind)
    return keys.model_copy(
        update={key: str(ROOT / "calibration" / getattr(keys, key)) for key in keys.file_keys}
    )


@pytest.mark.parametrize("kind", FORCE_SENSORS)
def test_the_parts_that_a_make_names_exist(kind):
    make = find_sensor(kind)
    assert all(load_object(place) for part in PARTS if (place := getattr(make, part)) is not None)
    assert issubclass(load_object(make.section), ForceSensorSection)


@pytest.mark.parametrize("kind", KINDS)
def test_a_built_in_make_has_every_part_that_a_plug_in_may_lack(kind):
    make = find_sensor(kind)
    assert None not in (make.driver, make.check)
    assert make.example
    assert make.address[0] in load_object(make.section).model_fields


@pytest.mark.parametrize("with_panel", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_driver_and_twin_understand_each_other_on_their_wire(kind, with_panel):
    make = find_sensor(kind)
    keys = example_of(kind)
    clock = TwinClock()
    rotor = Rotor(swing=0.5)
    wire = make.find_wire()
    faults = () if wire is None else (*wire.faults, *wire.port_faults)

    def make_twin(end):
        return make.make_twin(end, keys, (0.0,) * 6, np.random.default_rng(1))

    panel = FaultPanel(faults) if with_panel else None
    if wire is None:
        twin = make_twin(None)
        way = twin
    else:
        twin, way = wire.connect(keys, make_twin, panel)

    def process(to_s):
        twin.take_requests()
        times_s = twin.due(to_s)
        twin.take_wrench(rotor.advance(to_s, ShaftDrive(), times_s))

    clock.carry(process)
    sensor = make.make_driver(keys, way, clock)
    sensor.start()
    received = []
    for _ in range(50):
        clock.wait_until(clock.now_s() + 0.01)
        received.append(sensor.read())
    counts = np.concatenate([samples.counts for samples in received])
    assert len(counts) == pytest.approx(0.5 * keys.rate_Hz, rel=0.1)
    scale = sensor.scale()
    assert counts[:, 2].max() / scale.counts_per_N == pytest.approx(1.5, abs=0.1)
    assert sensor.health().notes == []


def test_a_rig_file_imports_no_driver_and_no_twin_of_a_sensor_that_it_does_not_name():
    code = (
        "from rfca_rig.description.rig_file import read_rig; from pathlib import Path; "
        "import sys; read_rig(Path('calibration/twin.toml'));"
        "print(*(name for name in sys.modules if name.startswith('rfca_rig.devices.')))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()
    assert "rfca_rig.devices.netft.section" in loaded
    assert not [
        name
        for name in loaded
        if ".ati_" in name or name.rpartition(".")[2] in {"driver", "twin", "checks", "ports"}
    ]
