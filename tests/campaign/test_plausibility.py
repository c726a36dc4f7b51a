"""Slips of unit and sign in an imported recording are found with the right guess; what is right
is left alone.
"""

import math
import re
import shutil
from dataclasses import replace

import pytest

from rfca_rig.campaign.opening import open_with_nominal_model
from rfca_rig.campaign.plausibility import find_slips
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

DEG = 180.0 / math.pi


def times(factor):
    return lambda values: values * factor


def nominal(section, key, factor):
    def slip(recording):
        values = recording.nominal[section][key]
        if isinstance(values, list | tuple):
            other = [value * factor for value in values]
        else:
            other = values * factor
        return replace(
            recording,
            nominal={**recording.nominal, section: {**recording.nominal[section], key: other}},
        )

    return slip


def column(names, change):
    def slip(recording):
        def changed(stroke):
            streams = {}
            for name, stream in stroke.streams.items():
                columns = {
                    key: replace(one, data=change(one.values)) if key in names else one
                    for key, one in stream.columns.items()
                }
                streams[name] = replace(stream, columns=columns)
            return replace(stroke, streams=streams)

        return replace(recording, strokes=tuple(map(changed, recording.strokes)))

    return slip


def without(name, slip):
    """The same slip in a recording that lacks a column."""

    def both(recording):
        def less(stroke):
            streams = {}
            for key, stream in stroke.streams.items():
                columns = dict(stream.columns)
                columns.pop(name, None)
                streams[key] = replace(stream, columns=columns)
            return replace(stroke, streams=streams)

        return slip(replace(recording, strokes=tuple(map(less, recording.strokes))))

    return both


def stroke(**changes):
    def slip(recording):
        return replace(
            recording,
            strokes=tuple(
                replace(one, **{key: change(getattr(one, key)) for key, change in changes.items()})
                for one in recording.strokes
            ),
        )

    return slip


def time(factor):
    def slip(recording):
        return replace(
            recording,
            strokes=tuple(
                replace(
                    one,
                    streams={
                        key: replace(stream, t_s=stream.t_s * factor)
                        for key, stream in one.streams.items()
                    },
                )
                for one in recording.strokes
            ),
        )

    return slip


def stage(**changes):
    def slip(recording):
        return replace(
            recording,
            strokes=(),
            static=tuple(
                replace(one, **{key: change(getattr(one, key)) for key, change in changes.items()})
                for one in recording.static
            ),
        )

    return slip


FORCES = ("fx_N", "fy_N", "fz_N")
SLIPS = {
    "height in m": (stroke(height_m=times(1e-3)), "metres"),
    "height in cm": (stroke(height_m=times(0.1)), "centimetres"),
    "height in inches": (stroke(height_m=times(1 / 25.4)), "inches"),
    "masses in kg": (nominal("leg", "link_masses_g", 1e-3), "kilograms"),
    "masses in pounds": (nominal("leg", "link_masses_g", 1 / 453.6), "pounds"),
    "lengths in m": (nominal("leg", "link_lengths_mm", 1e-3), "metres"),
    "lengths in cm": (nominal("leg", "link_lengths_mm", 0.1), "link lengths in centimetres"),
    "lengths in inches": (nominal("leg", "link_lengths_mm", 1 / 25.4), "inches"),
    "lengths in um": (nominal("leg", "link_lengths_mm", 1e3), "micrometres"),
    "height in um": (stroke(height_m=times(1e3)), "micrometres"),
    "masses in mg": (nominal("leg", "link_masses_g", 1e3), "milligrams"),
    "radius in um": (nominal("leg", "link_radius_mm", 1e3), "micrometres"),
    "start angle in mrad": (nominal("leg", "start_angle_rad", 1e3), "mrad"),
    "sensor's distance in um": (nominal("sensor", "below_shaft_mm", 1e3), "micrometres"),
    "ramp in us": (nominal("drive", "ramp_s", 1e6), "microseconds"),
    "speed in mrad/s": (stroke(speed_rad_s=times(1e3)), "mrad/s"),
    "radius in m": (nominal("leg", "link_radius_mm", 1e-3), "metres"),
    "start angle in deg": (nominal("leg", "start_angle_rad", DEG), "degrees"),
    "sensor's distance in m": (nominal("sensor", "below_shaft_mm", 1e-3), "metres"),
    "ramp in ms": (nominal("drive", "ramp_s", 1e3), "milliseconds"),
    "speed in deg/s": (stroke(speed_rad_s=times(DEG)), "deg/s"),
    "speed in rpm": (stroke(speed_rad_s=times(30 / math.pi)), "rpm"),
    "speed in turns/s": (stroke(speed_rad_s=times(0.5 / math.pi)), "turns per second"),
    "speed in deg/s without shaft": (
        without("shaft_angle_rad", stroke(speed_rad_s=times(DEG))),
        "deg/s",
    ),
    "speed in rpm without shaft": (
        without("shaft_angle_rad", stroke(speed_rad_s=times(30 / math.pi))),
        "rpm",
    ),
    "angle in deg": (column(("shaft_angle_rad",), times(DEG)), "degrees"),
    "angle in mrad": (column(("shaft_angle_rad",), times(1e3)), "mrad"),
    "angle in turns": (column(("shaft_angle_rad",), times(0.5 / math.pi)), "shaft angle in turns"),
    "angle turned": (column(("shaft_angle_rad",), times(-1.0)), "sign turned"),
    "forces in kN": (column(FORCES, times(1e-3)), "kN"),
    "forces in mN": (column(FORCES, times(1e3)), "mN"),
    "fz in kN": (column(("fz_N",), times(1e-3)), "kN"),
    "fy in kN": (column(("fy_N",), times(1e-3)), "kN"),
    "fz turned": (column(("fz_N",), times(-1.0)), "sign turned"),
    "tx in N mm": (column(("tx_Nm",), times(1e3)), "N mm"),
    "forces in gf": (column(FORCES, times(1e3 / 9.81)), "gf"),
    "fz in gf": (column(("fz_N",), times(1e3 / 9.81)), "gf"),
    "fz in mN": (column(("fz_N",), times(1e3)), "mN"),
    "tx in N cm": (column(("tx_Nm",), times(100.0)), "N cm"),
    "tx in kN m": (column(("tx_Nm",), times(1e-3)), "kN m"),
    "time in ms": (time(1e3), "milliseconds"),
    "time in us": (time(1e6), "microseconds"),
    "time in ns": (time(1e9), "nanoseconds"),
    "time in minutes": (time(1 / 60), "minutes"),
    "stages' forces in kN": (stage(fy_N=times(1e-3), fz_N=times(1e-3)), "kN"),
    "stages' forces in gf": (stage(fy_N=times(1e3 / 9.81), fz_N=times(1e3 / 9.81)), "gf"),
    "stages' moment in N mm": (stage(tx_Nm=times(1e3)), "N mm"),
    "stages' angle in mrad": (stage(shaft_angle_rad=times(1e3)), "mrad"),
    "stages' height in m": (stage(height_m=times(1e-3)), "metres"),
    "stages' height in cm": (stage(height_m=times(0.1)), "centimetres"),
    "stages' angle in deg": (stage(shaft_angle_rad=times(DEG)), "degrees"),
}


CAMPAIGN = ROOT / "tests" / "data" / "small-campaign"


@pytest.fixture(scope="module")
def right():
    return read_campaign(CAMPAIGN)


def test_right_values_are_left_alone(right):
    assert find_slips(right) == []


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_is_found_with_the_unit_that_was_meant(right, name):
    slip, unit = SLIPS[name]
    found = find_slips(slip(right))
    assert found
    assert unit in found[0].words


@pytest.mark.slow
def test_commands_refuse_a_slip_and_as_is_takes_it(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "campaign"
    shutil.copytree(CAMPAIGN, folder)
    said = typed(monkeypatch, capsys, "check", folder)
    assert said.exit_code == 0, said.err
    assert "values plausible" in said.err
    file = folder / "campaign.toml"
    file.write_text(
        re.sub(
            r"height_mm = (\d+\.\d+)",
            lambda found: f"height_mm = {float(found[1]) / 1e3}",
            file.read_text(),
        )
    )
    commands = [
        ("import",),
        ("report",),
        ("diagnose",),
        ("diagnose", "--each"),
        ("static", "report"),
    ]
    for words in (
        ("check", folder),
        ("fit", folder, "--parameters", "k0"),
        *((*one, folder, "--out", tmp_path / "out") for one in commands),
    ):
        said = typed(monkeypatch, capsys, *words)
        assert said.exit_code == (1 if "--each" in words else 2), words
        assert "metres or link lengths in micrometres?" in said.out + said.err
        assert said.err.count("\n") == 1
        # --each leaves an empty folder for the diagnoses that can be made.
        assert not list((tmp_path / "out").glob("*"))
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
    assert len(open_with_nominal_model([folder], as_is=True)[0].strokes) == 4
    with pytest.raises(BadInput, match="take it with --as-is"):
        open_with_nominal_model([folder], as_is=False)
    assert (
        typed(monkeypatch, capsys, "import", folder, "--out", tmp_path / "out", "--as-is").exit_code
        == 0
    )
