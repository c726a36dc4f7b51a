"""Files as other programs write them: read as they are meant, or refused with the true cause.

The same samples in every form: of separators, decimals, headers, units and times of tables of text;
of shapes, scales and records of HDF5 and MATLAB; of kinds that cannot be read.
"""

import gzip
from itertools import product

import h5py
import numpy as np
import pytest
import scipy.io

from rfca_rig.campaign.experiment import write_draft
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import list_columns, read_columns
from rfca_rig.campaign.table import select_samples
from rfca_rig.campaign.units import are_different, find_factor
from rfca_rig.errors import BadInput

SAMPLES = 40
T_S = 0.004 * np.arange(SAMPLES)
POSITION = np.round(0.7 * np.sin(60.0 * T_S) - 0.25, 6)
TORQUE = np.round(12.5 * np.cos(45.0 * T_S), 5)
NAMES = ("time", "position", "torque")
HOLDS = {"position": "the position of joint elbow", "torque": "the command of motor"}


def request(time="time", unit="s", holds=None):
    return ColumnRequest(TimeSection(column=time, unit=unit), holds or HOLDS, 0.05)


def assert_read(recording, time="time", position="position", torque="torque", factor=1.0):
    assert recording.t_s - recording.t_s[0] == pytest.approx(T_S, abs=1e-6)
    assert recording.values[position] == pytest.approx(POSITION * factor, abs=1e-6)
    assert recording.values[torque] == pytest.approx(TORQUE, abs=1e-5)


def refuse(path, asked=None):
    with pytest.raises(BadInput) as refused:
        read_columns(path, asked or request())
    said = str(refused.value)
    assert said.startswith(str(path))
    assert "\n" not in said
    return said.removeprefix(str(path))


SEPARATORS = {"commas": ",", "semicolons": ";", "tabs": "\t", "blanks": "  "}
DECIMALS = {"points": ".", "decimal commas": ","}
PREAMBLES = {
    "no preamble": "",
    "remarks": "#Digilent WaveForms Acquisition\n#Date Time: 2021-04-14 13:10:34\n\n",
    "an instrument's header": "Model,TBS2000\nFirmware Version,1.20\nSample Interval,0.004\n\n",
    "a title": "Pendulum run 7 of 12, recorded by the lab in the afternoon\n",
}
UNIT_ROWS = {
    "no units": "",
    "units": ("s", "rad", "N*m"),
    "units in brackets": ("[s]", "[rad]", "[Nm]"),
}
LINE_ENDS = {"unix": "\n", "windows": "\r\n"}


def write_text(path, separator=",", decimal=".", preamble="", units="", end="\n", names=NAMES):
    lines = [separator.join(names)]
    if units:
        lines.append(separator.join(units))
    for sample in zip(T_S, POSITION, TORQUE, strict=True):
        cells = [f"{value:.7f}".replace(".", decimal) for value in sample]
        lines.append(separator.join(cells))
    text = preamble + "\n".join(lines) + "\n"
    path.write_text(text.replace("\n", end), encoding="utf-8", newline="")
    return path


DIALECTS = [
    pytest.param(*form, id=", ".join(form))
    for form in product(SEPARATORS, DECIMALS, PREAMBLES, UNIT_ROWS, LINE_ENDS)
    # Nothing tells decimals from columns there, which is refused below.
    if form[:2] != ("commas", "decimal commas")
]


@pytest.mark.parametrize(("separator", "decimal", "preamble", "units", "end"), DIALECTS)
def test_a_table_is_read_in_every_dialect(tmp_path, separator, decimal, preamble, units, end):
    path = write_text(
        tmp_path / "run.csv",
        SEPARATORS[separator],
        DECIMALS[decimal],
        PREAMBLES[preamble],
        UNIT_ROWS[units],
        LINE_ENDS[end],
    )
    recording = read_columns(path, request())
    assert_read(recording)
    listed = list_columns(path)
    assert listed.times == ("time",)
    assert listed.values["torque"] == pytest.approx(TORQUE, abs=1e-5)
    if units != "no units":
        assert recording.units["position"] == "rad"
        assert not are_different(recording.units["torque"], "N m")
    has_note = (separator, decimal, preamble, units) != (
        *("commas", "points"),
        *("no preamble", "no units"),
    )
    assert bool(recording.notes) == has_note


@pytest.mark.parametrize("name", ["run.csv", "run.txt", "run.dat", "run.csv.gz"])
def test_the_ending_of_a_table_does_not_matter(tmp_path, name):
    path = write_text(tmp_path / "plain.csv", separator="\t")
    content = path.read_bytes()
    path = tmp_path / name
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    assert_read(read_columns(path, request()))


def test_a_header_behind_a_sign_for_remarks_is_one(tmp_path):
    path = write_text(tmp_path / "run.csv", separator=" ", names=("# time", *NAMES[1:]))
    assert_read(read_columns(path, request()))


def test_labviews_header_and_its_empty_column_of_comments(tmp_path):
    preamble = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nChannels\t2\t\n"
    path = write_text(
        tmp_path / "run.lvm", "\t", preamble=preamble, names=("X_Value", *NAMES[1:], "Comment")
    )
    assert_read(read_columns(path, request(time="X_Value")))


def test_decimal_commas_between_commas_are_refused(tmp_path):
    path = write_text(tmp_path / "run.csv", decimal=",")
    assert "do its numbers have a decimal comma?" in refuse(path)


def write_time_cells(path, cells):
    lines = ["time,position,torque"]
    for cell, position, torque in zip(cells, POSITION, TORQUE, strict=True):
        lines.append(f'"{cell}",{position:.6f},{torque:.6f}')
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_commas_separate_thousands_where_a_cell_has_two(tmp_path):
    microseconds = np.round(1e6 * (T_S + 0.95)).astype(int)
    path = write_time_cells(tmp_path / "run.csv", [f"{value:,}" for value in microseconds])
    recording = read_columns(path, request(unit="us"))
    assert_read(recording)
    assert "time: commas separate thousands" in recording.notes


def test_a_comma_that_may_be_either_is_refused_with_both_meanings(tmp_path):
    milliseconds = np.round(1e3 * T_S).astype(int) + 1000
    path = write_time_cells(tmp_path / "run.csv", [f"{value:,}" for value in milliseconds])
    said = refuse(path, request(unit="ms"))
    assert said.startswith(
        ":2: column time: 1,000 has a comma, which may be before the decimals or the thousands"
    )


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_and_times_become_seconds(tmp_path, zone):
    cells = [f"2024-05-01T12:00:{second:09.6f}{zone}" for second in T_S]
    path = write_time_cells(tmp_path / "run.csv", cells)
    recording = read_columns(path, request())
    assert recording.t_s - recording.t_s[0] == pytest.approx(T_S, abs=1e-6)
    assert recording.units["time"] == "s"


def test_a_date_that_is_none_is_named_with_its_line(tmp_path):
    cells = [f"2024-05-01T12:00:{second:09.6f}" for second in T_S]
    cells[5] = "2024-05-32T12:00:00"
    assert ":7: column time: '2024-05-32T12:00:00' is no date and time" in refuse(
        write_time_cells(tmp_path / "run.csv", cells)
    )


@pytest.mark.parametrize("digits", ["text", "float32"])
def test_times_with_too_few_digits_are_called_that(tmp_path, digits):
    since_1970_s = 1.7145e9 + T_S
    if digits == "text":
        cells = [f"{value:g}" for value in since_1970_s]
    else:
        cells = [repr(float(value)) for value in since_1970_s.astype(np.float32)]
    recording = read_columns(write_time_cells(tmp_path / "run.csv", cells), request())
    with pytest.raises(BadInput, match="it has the same time as the sample above, as 39 of 40"):
        select_samples(recording, recording.t_s, None, None)


def test_a_step_back_is_said_in_a_form_that_can_be_read(tmp_path):
    cells = [f"{1.7145e9 + second:.6f}" for second in T_S]
    cells[9] = f"{1.7145e9 + T_S[8] - 0.007:.6f}"
    recording = read_columns(write_time_cells(tmp_path / "run.csv", cells), request())
    with pytest.raises(BadInput, match=r"run\.csv:11: .*: it is 0\.007 s before the sample above"):
        select_samples(recording, recording.t_s, None, None)


def test_two_columns_of_one_name_are_refused_where_they_are_used(tmp_path):
    path = tmp_path / "run.csv"
    lines = ["time,position,torque,remark,position,remark"]
    lines += [
        f"{t:.6f},{q},{tau},1,{2 * q},2" for t, q, tau in zip(T_S, POSITION, TORQUE, strict=True)
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    assert ":1: two columns are named position (2 and 5); rename one" in refuse(path)
    listed = list_columns(path)
    assert listed.values["position"] is None
    assert "two columns are named position; rename one to use it" in listed.notes
    # Those that nobody asks for do no harm.
    assert read_columns(path, request(holds={"torque": "the command"})).values["torque"].size


# What is stored of a column, its attributes, and the factor to what is meant.
SCALED = {
    "plain": (POSITION, {}, 1.0),
    "a scale of one": (POSITION, {"conversion": 1.0}, 1.0),
    "CF": (np.round((POSITION - 0.5) / 1e-4).astype(np.int16), {"scale_factor": 1e-4}, 1.0),
    "CF with an offset": (
        np.round((POSITION - 0.5) / 1e-6).astype(np.int32),
        {"scale_factor": 1e-6, "add_offset": 0.5},
        1.0,
    ),
    "this program's runs": (np.round(POSITION / 1e-6).astype(np.int32), {"conversion": 1e-6}, 1.0),
    "NWB": (
        np.round((POSITION + 2.0) / 1e-6).astype(np.int32),
        {"conversion": 1e-6, "offset": -2.0},
        1.0,
    ),
    "NeXus": (np.round(POSITION / 1e-6).astype(np.int32), {"scaling_factor": 1e-6}, 1.0),
    "an offset that is text": (POSITION, {"offset": "2024-05-01T12:00:00"}, 1.0),
}


@pytest.mark.parametrize("form", SCALED)
def test_counts_are_read_in_the_unit_of_their_attributes(tmp_path, form):
    stored, attributes, _ = SCALED[form]
    expected = POSITION - 0.5 if form == "CF" else POSITION
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["time"] = T_S
        file["torque"] = TORQUE
        file["position"] = stored
        file["position"].attrs.update({"units": "deg", **attributes})
    recording = read_columns(path, request())
    tolerance = 1e-4 if form == "CF" else 2e-6
    assert recording.values["position"] == pytest.approx(expected, abs=tolerance)
    assert recording.units == {"position": "deg"}
    assert any("position: its numbers times" in note for note in recording.notes) == (
        form not in ("plain", "a scale of one", "an offset that is text")
    )
    assert list_columns(path).values["position"] == pytest.approx(expected, abs=tolerance)


def test_a_fill_value_is_no_number(tmp_path):
    path = tmp_path / "run.h5"
    counts = np.round(POSITION / 1e-4).astype(np.int16)
    counts[7] = -32768
    with h5py.File(path, "w") as file:
        file["time"] = T_S
        file["torque"] = TORQUE
        file["position"] = counts
        file["position"].attrs.update({"scale_factor": 1e-4, "_FillValue": np.int16(-32768)})
    assert ": column position: sample 8 is nan" in refuse(path)


SHAPES = {
    "vectors": lambda values: values,
    "rows": lambda values: values[None, :],
    "columns": lambda values: values[:, None],
}


@pytest.mark.parametrize(
    ("shape", "kind"),
    list(product(SHAPES, ["HDF5", "MATLAB 7.3", "MATLAB 5", "MATLAB 5, a structure"])),
)
def test_a_matrix_of_one_row_or_column_is_a_vector(tmp_path, shape, kind):
    arrays = {
        name: SHAPES[shape](values)
        for name, values in zip(NAMES, (T_S, POSITION, TORQUE), strict=True)
    }
    prefix = ""
    if kind == "MATLAB 5":
        path = tmp_path / "run.mat"
        scipy.io.savemat(path, arrays)
    elif kind == "MATLAB 5, a structure":
        path = tmp_path / "run.mat"
        scipy.io.savemat(path, {"log": arrays})
        prefix = "log/"
    else:
        path = tmp_path / ("run.h5" if kind == "HDF5" else "run.mat")
        # MATLAB begins its files with a block of 512 bytes of its own.
        size = 0 if kind == "HDF5" else 512
        with h5py.File(path, "w", userblock_size=size) as file:
            for name, values in arrays.items():
                file[name] = values
    holds = {f"{prefix}{name}": meaning for name, meaning in HOLDS.items()}
    recording = read_columns(path, request(f"{prefix}time", holds=holds))
    assert_read(recording, position=f"{prefix}position", torque=f"{prefix}torque")


@pytest.mark.parametrize("is_transposed", [False, True])
def test_columns_of_a_matrix_are_those_along_the_time(tmp_path, is_transposed):
    matrix = np.column_stack([POSITION, TORQUE])
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["time"] = T_S[None, :]
        file["x"] = matrix.T if is_transposed else matrix
    holds = {"x[0]": "the position", "x[1]": "the command"}
    recording = read_columns(path, request(holds=holds))
    assert_read(recording, position="x[0]", torque="x[1]")
    assert bool(recording.notes) == is_transposed
    listed = list_columns(path).values
    assert set(listed) == {"time", "x[0]", "x[1]"}
    assert "x has 2 columns, so the last is x[1]" in refuse(
        path, request(holds={"x[2]": "the command"})
    )


def test_fields_of_a_table_of_records_are_columns(tmp_path):
    path = tmp_path / "run.h5"
    kinds = [("time", "f8"), ("position", "f4"), ("torque", "f8"), ("state", "S4")]
    records = np.zeros(SAMPLES, dtype=kinds)
    records["time"] = T_S
    records["position"] = POSITION
    records["torque"] = TORQUE
    with h5py.File(path, "w") as file:
        file["log"] = records
    holds = {"log[position]": "the position", "log[torque]": "the command"}
    recording = read_columns(path, request("log[time]", holds=holds))
    assert_read(recording, position="log[position]", torque="log[torque]")
    listed = list_columns(path)
    assert listed.times == ("log[time]",)
    said = refuse(path, request("log/time"))
    assert (
        "log is a table of records with the fields time, position, torque, state; write log[time]"
        in said
    )
    assert "the field state holds |S4, no numbers" in refuse(
        path, request("log[time]", holds={"log[state]": "the position"})
    )


def test_blocks_of_a_pandas_table_are_columns(tmp_path):
    path = tmp_path / "run.h5"
    records = np.zeros(SAMPLES, dtype=[("index", "i8"), ("values_block_0", "f8", (3,))])
    records["values_block_0"] = np.column_stack([T_S, POSITION, TORQUE])
    with h5py.File(path, "w") as file:
        file["runs/table"] = records
    block = "runs/table[values_block_0]"
    holds = {f"{block}[1]": "the position", f"{block}[2]": "the command"}
    recording = read_columns(path, request(f"{block}[0]", holds=holds))
    assert_read(recording, position=f"{block}[1]", torque=f"{block}[2]")


FOREIGN = {
    "run.csv.zst": (b"\x28\xb5\x2f\xfd\x00", "is compressed by zstd; unpack it: zstd -d"),
    "run.csv.xz": (b"\xfd7zXZ\x00\x00", "is compressed by xz; unpack it: unxz"),
    "run.csv.bz2": (b"BZh91AY", "is compressed by bzip2; unpack it: bunzip2"),
    "run.npy": (b"\x93NUMPY\x01", "is a NumPy array; save it as CSV"),
    "run.npz": (b"PK\x03\x04", "is NumPy arrays; save them as CSV"),
    "run.xlsx": (b"PK\x03\x04", "is an Excel file; save it as CSV"),
    "run.zip": (b"PK\x03\x04", "is a zip archive; unpack it"),
    "run.xls": (b"\xd0\xcf\x11\xe0", "is an old Excel file; save it as CSV"),
}


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("ending", ["its own", ".csv"])
def test_a_file_of_another_kind_is_named_with_the_way_out(tmp_path, name, ending):
    beginning, said = FOREIGN[name]
    path = tmp_path / name
    # A wrong ending hides nothing, but that of a zip archive is all that tells what is in it.
    if ending == ".csv" and not beginning.startswith(b"PK"):
        path = tmp_path / "run.csv"
    path.write_bytes(beginning + bytes(600))
    assert said in refuse(path)


def test_a_column_named_date_is_no_can_log(tmp_path):
    path = write_text(tmp_path / "run.csv", names=("date time", *NAMES[1:]))
    assert_read(read_columns(path, request(time="date time")))


@pytest.mark.parametrize(
    ("unit", "other", "factor"),
    [
        ("Nm", "N m", 1.0),
        ("N*m", "N m", 1.0),
        ("kN", "N", 1000.0),
        ("mNm", "N m", 1e-3),
        ("deg", "rad", np.pi / 180.0),
        ("°", "rad", np.pi / 180.0),
        ("degrees", "deg", 1.0),
        ("rpm", "rad/s", np.pi / 30.0),
        ("dps", "deg/s", 1.0),
        ("rev", "turn", 1.0),
        ("µs", "us", 1.0),
        ("seconds", "s", 1.0),
        ("m/s^2", "m/s2", 1.0),
        ("lbf", "N", 4.4482216),
    ],
)
def test_units_are_read_as_engineers_write_them(unit, other, factor):
    assert find_factor(unit, other) == pytest.approx(factor)
    assert are_different(unit, other) == (factor != 1.0)


def test_what_is_no_unit_contradicts_nothing():
    assert not are_different("see manual", "rad")
    assert find_factor("see manual", "rad") is None
    assert find_factor("N", "rad") is None
    assert are_different("counts", "rad")


def test_a_draft_names_a_recording_of_another_kind(tmp_path):
    (tmp_path / "run.xlsx").write_bytes(b"PK\x03\x04" + bytes(600))
    with pytest.raises(BadInput, match=r"run\.xlsx: is an Excel file"):
        write_draft(None, tmp_path)
