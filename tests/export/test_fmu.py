"""The leg as an FMU against the compiled chain, played by functions of the standard and by FMPy."""

import ctypes
import importlib.util
import json
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest

from rfca_rig.errors import BadInput, RigError
from rfca_rig.export import fmu, fmu_code
from rfca_rig.export.fmu import LegModel, export_fmu
from rfca_rig.export.fmu_leg import check_effects, set_up_leg
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.chain import (
    HELD_SHAFT,
    Tolerance,
    advance,
    allocate_samples,
    allocate_workspace_of,
)
from rfca_rig.model.kernel.integrator import FIRST_STEP_S
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, Swing
from rfca_rig.model.setup import measure_at_rest
from rfca_rig.model.stroke import simulate_stroke
from tests.cli.typed import typed
from tests.export.fmu_player import ERROR, OK, PLATFORM, Fmu
from tests.model.legs import PAPER

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
END_S = 1.2
STEP_S = 1e-3
# Both sides round differently on some processors, and take other steps then: differences shrink
# with the tolerance.
TIGHT = 1e-9
HAS_ZIG = importlib.util.find_spec("ziglang") is not None
HAS_FMPY = importlib.util.find_spec("fmpy") is not None

needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None and not HAS_ZIG, reason="no C compiler: neither cc nor ziglang"
)
needs_fmpy = pytest.mark.skipif(not HAS_FMPY, reason="FMPy is not installed: pip install fmpy")


def effect(name, **values):
    return PresentEffect(name, tuple(values.items()))


def rig_with(*effects, holds_start=False):
    return replace(PAPER, effects=effects, drive=replace(PAPER.drive, holds_start=holds_start))


FRICTION = effect("hinge_coulomb_friction", torque_Nm=0.02, let_go=0.0)
BACKLASH = effect("hinge_backlash", half_gap_deg=0.3)
# A law with memory, which a second function updates.
HYSTERESIS = effect("spring_hysteresis", strength_relative=0.2, saturation_deg=3.0)
PLAY = effect("shaft_play", half_gap_deg=1.0)
DROOP = effect("motor_speed_droop", kp_Nm_s_per_rad=5.0, ki_Nm_per_rad=100.0)
# One more coordinate.
FRAME = effect("frame_compliance", frequency_Hz=20.0, moving_mass_kg=3.0, damping_ratio=0.03)

RIGS = {
    "plain": (PAPER, "speed"),
    "laws": (rig_with(FRICTION, BACKLASH, HYSTERESIS), "speed"),
    "a drive that sags": (rig_with(PLAY), "speed"),
    "a drive that holds": (rig_with(DROOP, holds_start=True), "speed"),
    "a frame": (rig_with(FRAME, effect("fluid_drag", coefficient_N_s2_per_m3=2.0)), "speed"),
    "torque": (rig_with(effect("shaft_friction", torque_Nm=0.1)), "torque"),
}
SAME_CODE = {}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Unpacks the FMU of one of `RIGS`, made once."""
    compile_leg = fmu.compile_leg

    def compile_once(layout, laws, platforms):
        # Legs whose numbers lie at the same places have the same code.
        key = str(sorted(layout.slots.items())), str([use.law for use in laws]), str(platforms)
        if key not in SAME_CODE:
            SAME_CODE[key] = compile_leg(layout, laws, platforms)
        return SAME_CODE[key]

    made = {}

    def export(name):
        if name not in made:
            folder = tmp_path_factory.mktemp("fmu")
            rig, shaft_input = RIGS[name]
            (folder / "rig.toml").write_text("a rig", encoding="utf-8")
            leg = LegModel(rig, 'A <"rig"> & its leg', "rig file", folder / "rig.toml")
            with pytest.MonkeyPatch.context() as patched:
                patched.setattr(fmu, "compile_leg", compile_once)
                export_fmu(leg, folder / "leg.fmu", HEIGHT_M, shaft_input)
            made[name] = Fmu(folder / "leg.fmu", folder / "unpacked")
        return made[name]

    return export


def inputs_of(shaft_input, step_s):
    """Input of every communication step: a ramp to a speed, or torque pulses of both signs."""
    end_s = step_s * np.arange(1, round(END_S / step_s) + 1)
    if shaft_input == "speed":
        return SPEED_RAD_S * np.minimum(end_s / 0.05, 1.0)
    return 1.5 * np.sin(7.0 * end_s) + 0.5


def chain_moves(rig, shaft_input, step_s, tolerance, height_m=HEIGHT_M, rotor_kg_m2=0.0):
    """Outputs (k + 1, outputs) of the compiled chain for the same inputs, from the rest on."""
    still = set_up_leg(rig, height_m)
    chain = still.chain()
    laws = still.compile_laws(chain)
    work = allocate_workspace_of(chain)
    shaft, state = still.begin(chain, laws, work)
    force = measure_at_rest(chain, laws, state, work)
    rows = [outputs_of(rig, chain, state, force, work.contact)]
    angle = rig.leg.start_angle_rad
    speed = last = 0.0
    next_s = FIRST_STEP_S
    for value in inputs_of(shaft_input, step_s):
        acceleration = (value - speed) / step_s
        if shaft_input == "torque":
            shaft = HELD_SHAFT._replace(free=True, feed=value, rotor=rotor_kg_m2)
        else:
            jumps = acceleration != last
            shaft = shaft._replace(
                breaks=np.array([0.0, step_s]),
                coefficient=np.array([[angle, speed, 0.5 * acceleration, 0.0]]),
                landings=np.zeros(int(jumps)),
            )
        samples = allocate_samples(np.array([step_s]), state.q.size, state.anchor.size)
        bounds = Tolerance(tolerance, 3e3 * tolerance)
        cost = advance(chain, shaft, state, (0.0, step_s), next_s, bounds, samples, laws, work)
        next_s = cost.next_s
        rows.append(outputs_of(rig, chain, state, samples.force[0], samples.contact[0]))
        angle += step_s * (speed + 0.5 * step_s * acceleration)
        speed += step_s * acceleration
        last = acceleration
    return np.array(rows)


def outputs_of(rig, chain, state, force, contact):
    links = state.q[: chain.length.size]
    fy, fz, torque = force
    tx = torque + rig.sensor.below_shaft_m * fy
    shaft = (links[0], state.w[0], torque, fy, fz, tx)
    return [*shaft, contact[0].sum(), contact[1].sum(), *np.diff(links)]


def largest_difference(values, expected):
    """Over all outputs, as a share of the range of each."""
    return float((np.abs(values - expected).max(axis=0) / np.ptp(expected, axis=0)).max())


def begun(leg, tolerance=TIGHT, **values):
    instance = leg.instance()
    assert instance.set(**values) == OK
    assert instance.initialize(tolerance) == OK, instance.messages
    return instance


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("step_s", [1e-3, 8e-3])
@pytest.mark.parametrize("name", RIGS)
def test_it_moves_as_the_compiled_chain(exported, name, step_s):
    rig, shaft_input = RIGS[name]
    instance = begun(exported(name))
    at_rest = instance.get(*instance.fmu.names("output"))
    values = np.vstack([at_rest, instance.play(inputs_of(shaft_input, step_s), step_s)])
    expected = chain_moves(rig, shaft_input, step_s, TIGHT)
    instance.free()
    assert largest_difference(values, expected) < 1e-6
    # The leg touches the ground.
    assert values[:, instance.fmu.names("output").index("contact_normal_N")].max() > 5.0


@needs_compiler
@pytest.mark.slow
def test_a_stroke_is_that_of_predict_whatever_the_communication_step(exported):
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, SPEED_RAD_S, 0.05, END_S)
    for step_s in (5e-4, 5e-3):
        instance = begun(exported("plain"))
        values = instance.play(inputs_of("speed", step_s), step_s)
        at_s = step_s * np.arange(1, len(values) + 1)
        stroke = simulate_stroke(PAPER, HEIGHT_M, motion, at_s, Tolerance(TIGHT, 3e3 * TIGHT))
        names = instance.fmu.names("output")
        for name in ("fy_N", "fz_N", "tx_Nm", "shaft_torque_Nm"):
            expected = getattr(stroke, name)
            difference = np.abs(values[:, names.index(name)] - expected).max()
            assert difference < 1e-6 * np.ptp(expected), name
        instance.free()


@needs_compiler
@pytest.mark.slow
def test_with_the_usual_tolerance_forces_are_near(exported):
    instance = begun(exported("plain"), tolerance=None)
    values = instance.play(inputs_of("speed", 5e-3), 5e-3)
    expected = chain_moves(PAPER, "speed", 5e-3, TIGHT)[1:]
    instance.free()
    fz = instance.fmu.names("output").index("fz_N")
    assert np.abs(values[:, fz] - expected[:, fz]).max() < 2e-3 * np.ptp(expected[:, fz])


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("name", ["laws", "torque"])
def test_two_at_once_a_reset_and_a_saved_state_give_the_same_bits(exported, name):
    leg = exported(name)
    inputs = inputs_of(RIGS[name][1], STEP_S)[:600]
    alone = begun(leg)
    expected = alone.play(inputs, STEP_S)
    # Two at once, in turns, one of them with another height.
    first = begun(leg)
    second = begun(leg, height_m=0.2)
    rows = []
    for number, value in enumerate(inputs):
        rows.append(first.play([value], STEP_S, number)[0])
        second.play([value], STEP_S, number)
    assert np.array_equal(rows, expected)
    # The one at the other height, after a reset.
    second.reset()
    second.initialize(TIGHT)
    assert np.array_equal(second.play(inputs, STEP_S), expected)
    # A state from the middle, as bytes into another instance.
    alone.reset()
    alone.initialize(TIGHT)
    alone.play(inputs[:300], STEP_S)
    content = save(alone)
    load(first, content)
    assert np.array_equal(first.play(inputs[300:], STEP_S, 300), expected[300:])
    assert np.array_equal(alone.play(inputs[300:], STEP_S, 300), expected[300:])
    for instance in (alone, first, second):
        instance.free()


def save(instance):
    state = ctypes.c_void_p()
    size = ctypes.c_size_t()
    assert instance.call("fmi3GetFMUState", ctypes.byref(state)) == OK
    assert instance.call("fmi3SerializedFMUStateSize", state, ctypes.byref(size)) == OK
    content = ctypes.create_string_buffer(size.value)
    assert instance.call("fmi3SerializeFMUState", state, content, size) == OK
    assert instance.call("fmi3FreeFMUState", ctypes.byref(state)) == OK
    assert not state.value
    return content


def load(instance, content):
    state = ctypes.c_void_p()
    size = ctypes.c_size_t(len(content))
    assert instance.call("fmi3DeserializeFMUState", content, size, ctypes.byref(state)) == OK
    assert instance.call("fmi3SetFMUState", state) == OK
    assert instance.call("fmi3FreeFMUState", ctypes.byref(state)) == OK


@needs_compiler
@pytest.mark.slow
def test_a_parameter_acts_as_the_value_of_the_rig(exported):
    leg = replace(
        PAPER.leg,
        start_angle_rad=0.9,
        k0_Nm_per_rad=8.0,
        k2_per_rad2=3.0,
        hinge_damping_Nm_s_per_rad=0.05,
    )
    ground = replace(
        PAPER.ground, stiffness_N_per_m1p5=5e4, damping_s_per_m=0.5, friction_coefficient=0.2
    )
    instance = begun(
        exported("plain"),
        height_m=0.2,
        start_angle_rad=0.9,
        k0_Nm_per_rad=8.0,
        k2_per_rad2=3.0,
        hinge_damping_Nm_s_per_rad=0.05,
        contact_stiffness_N_per_m1p5=5e4,
        contact_damping_s_per_m=0.5,
        friction_coefficient=0.2,
    )
    assert len(instance.fmu.names("parameter")) == 8
    # With these values it rests on the ground.
    assert instance.get("contact_normal_N")[0] > 1.0
    at_rest = instance.get(*instance.fmu.names("output"))
    values = np.vstack([at_rest, instance.play(inputs_of("speed", 5e-3), 5e-3)])
    changed = replace(PAPER, leg=leg, ground=ground)
    expected = chain_moves(changed, "speed", 5e-3, TIGHT, height_m=0.2)
    instance.free()
    assert largest_difference(values, expected) < 1e-6


@needs_compiler
@pytest.mark.slow
def test_the_inertia_of_a_drive_that_gives_its_torque(exported):
    rig, shaft_input = RIGS["torque"]
    instance = begun(exported("torque"), rotor_kg_m2=0.05)
    values = instance.play(inputs_of(shaft_input, 5e-3), 5e-3)
    expected = chain_moves(rig, shaft_input, 5e-3, TIGHT, rotor_kg_m2=0.05)
    instance.free()
    assert largest_difference(values, expected[1:]) < 1e-6


@needs_compiler
@pytest.mark.slow
def test_wrong_calls_are_refused_with_a_message(exported):
    leg = exported("plain")
    assert leg.library.fmi3GetVersion() == b"3.0"
    assert leg.instance("another token").model.value is None
    instance = leg.instance()
    assert instance.step(0.0, STEP_S) == ERROR
    assert instance.set(height_m=-1.0) == ERROR
    assert instance.set(fz_N=1.0) == ERROR
    assert instance.set(commanded_rad_s=np.nan) == ERROR
    assert instance.initialize(-1.0) == ERROR
    instance.reset()
    assert instance.initialize() == OK
    assert instance.set(height_m=0.2) == ERROR
    assert instance.step(0.0, 0.0) == ERROR
    assert instance.step(0.5, STEP_S) == ERROR
    assert instance.call("fmi3EnterEventMode") == ERROR
    assert [message.split(";")[0] for message in instance.messages] == [
        "a step follows the initialization",
        "height_m is -1",
        "variable 14 cannot be set",
        "the input must be a finite number",
        "the tolerance is -1",
        "height_m is fixed once a simulation has begun",
        "the communication step is 0 s",
        "the step begins at 0.5 s, where the model is at 0 s",
        "this model is for co-simulation, without events, clocks or derivatives",
    ]
    # None of them moved it.
    assert instance.play(inputs_of("speed", STEP_S)[:5], STEP_S).shape == (5, 14)
    instance.free()


@needs_compiler
@pytest.mark.slow
def test_a_leg_that_cannot_rest_fails_until_it_is_reset(exported):
    instance = exported("plain").instance()
    assert instance.set(k0_Nm_per_rad=1e308) == OK
    assert instance.initialize() == ERROR
    assert instance.step(0.0, STEP_S) == ERROR
    assert "no rest pose found" in instance.messages[0]
    instance.reset()
    assert (instance.initialize(), instance.step(0.0, STEP_S)) == (OK, OK)
    instance.free()


@needs_compiler
@pytest.mark.slow
def test_the_file_holds_what_the_standard_asks_for(exported):
    leg = exported("laws")
    text = (leg.folder / "modelDescription.xml").read_text(encoding="utf-8")
    assert 'modelName="A &lt;&quot;rig&quot;&gt; &amp; its leg: flexible leg"' in text
    assert re.search(r'generationTool="rfca-rig \d', text)
    page = (leg.folder / "documentation/index.html").read_text(encoding="utf-8")
    assert "hinge_coulomb_friction (torque_Nm 0.02" in page and "<rig" not in page
    assert re.search(r"SHA-256: [0-9a-f]{64}<", page)
    licence = (leg.folder / "documentation/licenses/license.txt").read_text(encoding="utf-8")
    assert licence.startswith("MIT License")
    units = set(re.findall(r'<Unit name="([^"]+)"', text))
    for name, keys in leg.variables.items():
        assert keys["unit"] in units if "unit" in keys else name == "friction_coefficient"


@needs_compiler
@needs_fmpy
@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_fmpy_validates_and_simulates_it(exported, name):
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    leg = exported(name)
    file = leg.folder.parent / "leg.fmu"
    assert validate_fmu(str(file)) == []
    inputs = inputs_of(RIGS[name][1], 5e-3)
    (input_name,) = leg.names("input")
    # The value that FMPy sets at the begin of a step is that of this time.
    times = 5e-3 * np.arange(len(inputs))
    signals = np.array(
        list(zip(times, inputs, strict=True)), dtype=[("time", float), (input_name, float)]
    )
    result = simulate_fmu(
        str(file),
        stop_time=5e-3 * len(inputs),
        output_interval=5e-3,
        input=signals,
        relative_tolerance=TIGHT,
        output=leg.names("output"),
    )
    instance = begun(leg)
    expected = instance.play(inputs, 5e-3)
    instance.free()
    values = np.column_stack([result[name] for name in leg.names("output")])
    # FMPy interpolates the input, to rounding.
    assert largest_difference(values[1:], expected) < 1e-6


def warnings_of(tmp_path, monkeypatch, *options):
    header, _ = written(tmp_path, monkeypatch, rig_with(FRICTION, HYSTERESIS))
    (tmp_path / "leg.h").write_text(header, encoding="ascii")
    source = Path(fmu.__file__).with_name("fmu_interface.c")
    strict = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-fsyntax-only")
    command = ["cc", *strict, f"-I{tmp_path}", *options, str(source)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


def written(tmp_path, monkeypatch, rig):
    """The files that an export would compile and pack, without compiling: leg.h, and the
    description of the model.
    """
    headers = []

    def store_header(_, header, code):
        headers.append(header)
        return code

    with monkeypatch.context() as patched:
        patched.setattr(fmu, "_find_compiler", lambda _: ["cc"])
        patched.setattr(fmu, "compile_leg", lambda *_: [b""])
        patched.setattr(fmu, "_build_binary", store_header)
        (tmp_path / "rig.toml").write_text("a rig", encoding="utf-8")
        leg = LegModel(rig, "leg", "rig file", tmp_path / "rig.toml")
        export_fmu(leg, tmp_path / "leg.fmu", HEIGHT_M, "speed", [PLATFORM])
    with zipfile.ZipFile(tmp_path / "leg.fmu") as archive:
        return headers[0], archive.read("modelDescription.xml").decode()


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc")
def test_the_program_in_c_compiles_without_warnings(tmp_path, monkeypatch):
    assert warnings_of(tmp_path, monkeypatch) == ""


@needs_fmpy
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc")
def test_its_functions_are_those_of_the_standard(tmp_path, monkeypatch):
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    own = ("-DFMI3_HEADER=<fmi3Functions.h>", f"-isystem{headers}")
    assert warnings_of(tmp_path, monkeypatch, *own) == ""
    text = (headers / "fmi3Functions.h").read_text(encoding="utf-8")
    wanted = set(re.findall(r"FMI3_Export fmi3\w+TYPE +(fmi3\w+);", text))
    source = Path(fmu.__file__).with_name("fmu_interface.c")
    command = ["cc", "-E", f"-I{tmp_path}", str(source)]
    expanded = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    defined = set(re.findall(r"(fmi3\w+)\([^;{}]*\)\s*\{", expanded))
    assert len(wanted) > 70 and wanted <= defined


REFUSED = {
    "readings of the force sensor": effect("sensor_gain", factor=1.1),
    "a motion that is known beforehand": effect(
        "motor_speed_ripple", amplitude_relative=0.05, cycles_per_turn=10.0
    ),
    "the number of strokes before": effect("stiffness_fading", loss_per_decade_relative=0.05),
}


@pytest.mark.parametrize("words", REFUSED)
def test_an_effect_that_an_fmu_cannot_have_is_refused(words):
    with pytest.raises(BadInput, match=words) as refused:
        check_effects(rig_with(FRICTION, REFUSED[words]), HEIGHT_M, "speed")
    assert REFUSED[words].id in str(refused.value)


def test_a_drive_is_refused_beside_a_torque():
    check_effects(rig_with(PLAY), HEIGHT_M, "speed")
    with pytest.raises(BadInput, match=r"effect shaft_play: .*--input torque replaces"):
        check_effects(rig_with(PLAY), HEIGHT_M, "torque")


def test_a_leg_that_swings_is_refused():
    with pytest.raises(BadInput, match="begins at rest"):
        check_effects(replace(PAPER, swing=Swing(0.1, 0.5, 0.0)), HEIGHT_M, "speed")


def test_a_value_from_which_an_effect_computes_something_else_is_not_open(tmp_path, monkeypatch):
    def open_names(*effects):
        _, description = written(tmp_path, monkeypatch, rig_with(*effects))
        parameter = r'<Float64 name="(\w+)" valueReference="1\d+" causality="parameter"'
        assert re.search(f'name="height_m" .*start="{HEIGHT_M}"', description)
        return set(re.findall(parameter, description))

    plain = open_names()
    assert len(plain) == 8
    soft = effect("ground_compliance", stiffness_N_per_m1p5=2e5)
    assert plain - open_names(soft) == {"contact_stiffness_N_per_m1p5"}
    # A straight line with another slope or an intercept stays open.
    assert open_names(effect("height_offset", offset_mm=3.0)) == plain


def test_code_that_needs_python_is_refused():
    needs = "declare ptr @NRT_Allocate(i64)\ndeclare double @exp(double)\n"
    with pytest.raises(RigError, match="needs NRT_Allocate, which only Python has"):
        fmu_code._check_externals(llvm.parse_assembly(needs))


@pytest.mark.slow
def test_every_effect_of_a_leg_is_refused_or_needs_no_python():
    refused = set()
    for name, entry in catalogue().items():
        values = {parameter.name: parameter.high for parameter in entry.parameters}
        rig = rig_with(effect(name, **values))
        try:
            check_effects(rig, HEIGHT_M, "speed")
        except BadInput:
            refused.add(name)
            continue
        setup = set_up_leg(rig, HEIGHT_M)
        laws = setup.list_laws(setup.chain())
        fmu_code._check_externals(fmu_code._link(fmu_code._compile_laws(laws)))
    assert {"stiffness_fading", "motor_speed_ripple"} < refused
    assert all(
        name.startswith(("sensor", "clock")) or name in ("stiffness_fading", "motor_speed_ripple")
        for name in refused
    )


def test_what_is_missing_is_said_before_anything_is_compiled(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fmu, "compile_leg", partial(pytest.fail, "compiled"))
    monkeypatch.setattr(fmu, "find_spec", lambda _: None)
    out = tmp_path / "leg.fmu"
    words = ("export", "fmu", "--out", out, "--platform")
    other = "x86_64-windows" if PLATFORM == "x86_64-linux" else "x86_64-linux"
    said = typed(monkeypatch, capsys, *words, other)
    assert said.exit_code == 2 and not out.exists()
    assert said.err == (
        f"rfca-rig: no C compiler for {other}: there is none of the system, and the extra fmu, "
        'which brings one, is not installed; type pip install "rfca-rig[fmu]"\n'
    )


def test_a_computer_with_another_processor_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fmu.this_platform, "machine", lambda: "arm64")
    words = ("export", "fmu", "--out", tmp_path / "leg.fmu", "--platform", "x86_64-windows")
    said = typed(monkeypatch, capsys, *words)
    assert (said.exit_code, said.err.count("\n")) == (2, 1)
    assert "this computer is none of x86_64-linux, x86_64-windows" in said.err


@needs_compiler
@pytest.mark.slow
def test_the_command(tmp_path, monkeypatch, capsys):
    out = tmp_path / "leg.fmu"
    platforms = ["x86_64-linux", "x86_64-windows"] if HAS_ZIG else [PLATFORM]
    words = [word for platform in platforms for word in ("--platform", platform)]
    said = typed(monkeypatch, capsys, "export", "fmu", "--out", out, "--json", *words)
    assert said.exit_code == 0, said.err
    answer = json.loads(said.out)
    assert answer["platforms"] == platforms
    assert answer["inputs"] == ["commanded_rad_s"]
    assert len(answer["outputs"]) == 14
    assert [words.split(":")[0] for words in answer["left_out"]] == [
        "ramp_s of [drive]",
        "noise_std of [sensor]",
        "[twin]",
    ]
    with zipfile.ZipFile(out) as archive:
        binaries = [name for name in archive.namelist() if name.startswith("binaries/")]
        assert [name.split("/")[1] for name in binaries] == platforms
        first = {name.rpartition(".")[2]: archive.read(name)[:2] for name in binaries}
    assert first.get("dll", b"MZ") == b"MZ" and first.get("so", b"\x7fE") == b"\x7fE"
    instance = Fmu(out, tmp_path / "unpacked").instance()
    assert (instance.initialize(), instance.step(0.0, STEP_S)) == (OK, OK)
    instance.free()
