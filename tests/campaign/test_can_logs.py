"""Logs of a CAN bus as python-can writes them: signals of a database as columns over one time base,
and every fault in one line.
"""

import gzip

import numpy as np
import pytest

from rfca_rig.campaign import recorded_files
from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import find_recordings, list_columns, read_columns
from rfca_rig.errors import BadInput
from tests.campaign.drafts import MODEL, drafted
from tests.campaign.small import copy_to

pytest.importorskip("cantools")

from tests.campaign import can_logs
from tests.campaign.can_logs import encoder_frames, frame, raw_frame, torque_frames

T_S = 0.01 * np.arange(60)
POSITION = "Encoder.Position"
TORQUE = "Torque.Little"
# TRC has tenths of a millisecond in its older version, microseconds in others.
WITHIN_S = 2e-6


@pytest.fixture
def databases(tmp_path):
    return [can_logs.write_database(tmp_path)]


@pytest.fixture(params=can_logs.ENDINGS)
def log(request, tmp_path):
    """Makes a log of each kind."""

    def write(frames, **options):
        return can_logs.write_log(tmp_path / f"run{request.param}", frames, **options)

    return write


def read(path, databases, *columns, time="log time", unit="s", bus=None, longest_gap_s=0.05):
    holds = dict.fromkeys(columns or (POSITION, TORQUE), "the position of joint elbow")
    request = ColumnRequest(
        TimeSection(column=time, unit=unit), holds, longest_gap_s, databases, bus
    )
    return read_columns(path, request)


def refuse(path, databases, *columns, **options):
    with pytest.raises(BadInput) as refused:
        read(path, databases, *columns, **options)
    said = str(refused.value)
    assert "\n" not in said
    return said


@pytest.mark.parametrize("begin_s", [can_logs.BEGIN_S, 0.0], ids=["since 1970", "from 0"])
def test_signals_of_a_database_are_columns_with_its_units(log, databases, begin_s):
    path = log([*encoder_frames(T_S), *torque_frames(T_S)], begin_s=begin_s)
    recording = read(path, databases, POSITION, "Encoder.Velocity", TORQUE, "Torque.Big")
    assert recording.t_s == pytest.approx(T_S, abs=WITHIN_S)
    assert recording.values[POSITION] == pytest.approx(np.sin(T_S), abs=1e-6)
    assert recording.values["Encoder.Velocity"] == pytest.approx(np.cos(T_S), abs=1e-6)
    assert recording.values[TORQUE] == pytest.approx(3.0 * np.cos(T_S), abs=6e-4)
    assert recording.values["Torque.Big"] == pytest.approx(-7.0 * np.cos(T_S), abs=6e-5)
    assert recording.units == {
        POSITION: "rad",
        "Encoder.Velocity": "rad/s",
        TORQUE: "Nm",
        "Torque.Big": "Nm",
    }
    assert not recording.notes


def test_messages_of_other_rates_are_interpolated_to_the_first_signal(log, databases):
    frames = [*encoder_frames(T_S), *torque_frames(np.arange(0.123, 0.4, 0.007))]
    recording = read(log(frames), databases)
    assert recording.t_s[[0, -1]] == pytest.approx([0.13, 0.39], abs=WITHIN_S)
    assert recording.values[TORQUE] == pytest.approx(3.0 * np.cos(recording.t_s), abs=7e-4)


@pytest.mark.parametrize("ending", [".blf", ".asc", ".log"])
def test_frames_of_can_fd_are_read_to_their_last_byte(tmp_path, databases, ending):
    frames = [frame(t, "Wide", {"Last": np.sin(t)}, bitrate_switch=True) for t in T_S]
    path = can_logs.write_log(tmp_path / f"run{ending}", frames)
    recording = read(path, databases, "Wide.Last")
    assert recording.values["Wide.Last"] == pytest.approx(np.sin(T_S), abs=1e-6)


def test_frames_of_can_fd_in_a_log_of_peak_are_read(tmp_path, databases):
    """As PCAN-View writes them; python-can's writer knows no CAN FD."""
    lines = [";$FILEVERSION=2.1", ";$STARTTIME=45412.75", ";$COLUMNS=N,O,T,B,I,d,R,L,D"]
    for number, t_s in enumerate(T_S, start=1):
        data = bytes(60) + np.float32(np.sin(t_s)).tobytes()
        lines.append(f"{number:7} {1e3 * t_s:13.3f} FB 1 0401 Rx - 15   {data.hex(' ').upper()}")
    path = tmp_path / "run.trc"
    path.write_text("\n".join(lines) + "\n")
    recording = read(path, databases, "Wide.Last")
    assert recording.values["Wide.Last"] == pytest.approx(np.sin(T_S), abs=1e-6)


def status_frames(t_s, page, name, value=20.0):
    return [frame(t, "Status", {"Page": page, name: value}) for t in t_s]


def test_signals_that_share_bytes_have_the_times_of_their_own_frames(log, databases):
    frames = [
        *encoder_frames(T_S),
        *status_frames(T_S + 0.002, 0, "Temperature"),
        *status_frames(T_S + 0.005, 1, "Current", 3.0),
    ]
    recording = read(log(frames), databases, POSITION, "Status.Temperature", "Status.Current")
    assert recording.values["Status.Temperature"] == pytest.approx(np.full(59, 20.0))
    assert recording.values["Status.Current"] == pytest.approx(np.full(59, 3.0))


def test_frames_that_cannot_be_used_are_left_out_with_a_note(log, databases):
    frames = [
        *encoder_frames(T_S),
        *torque_frames(T_S),
        # An identifier of 29 bits is not that of 11 bits with the same number.
        raw_frame(0.101, 41, bytes(8), is_extended_id=True),
        raw_frame(0.102, 0x7FF, bytes(8)),
        raw_frame(0.103, 41, b"\x00\x00\x80\x3f"),
        *status_frames(T_S + 0.004, 1, "Current", 1.5),
        *status_frames([0.1045], 1, "Current", 327.67),
        raw_frame(0.106, 512, b"\x09" + bytes(7)),
        raw_frame(0.107, 41, b"", is_remote_frame=True, dlc=8),
    ]
    recording = read(log(frames), databases, "Encoder.Velocity", "Torque.Little", "Status.Current")
    assert recording.notes == (
        "2 frames that motor.dbc does not define are left out: 0x00000029, 0x7FF",
        (
            "message Encoder: 1 frames are shorter than the database states; signals that they do "
            "not hold are left out"
        ),
        (
            "message Status: 1 frames cannot be decoded and are left out: expected multiplexer id "
            "0 or 1, but got 9"
        ),
        "Status.Current: 1 values named SNA are left out",
    )
    assert recording.values["Encoder.Velocity"] == pytest.approx(np.cos(recording.t_s), abs=1e-5)
    assert recording.values["Status.Current"] == pytest.approx(np.full(len(recording.t_s), 1.5))


def test_a_shorter_frame_still_gives_the_signals_that_it_holds(log, databases):
    frames = [raw_frame(t, 41, np.float32(np.sin(t)).tobytes()) for t in T_S]
    path = log(frames)
    assert read(path, databases, POSITION).values[POSITION] == pytest.approx(np.sin(T_S), abs=1e-6)
    said = refuse(path, databases, "Encoder.Velocity")
    assert "none of 60 frames holds it: they have up to 4 bytes, and the database states 8" in said


def test_what_a_log_does_not_hold_is_named(log, databases):
    path = log([*encoder_frames(T_S), *status_frames(T_S, 0, "Temperature")])
    said = refuse(path, databases)
    assert "the log has no frame of message Torque (0x00000200); its frames have" in said
    assert said.endswith("the identifiers 0x029, 0x200")
    assert "none of 60 frames holds it: they select others of the signals" in refuse(
        path, databases, "Status.Current"
    )
    assert "motor.dbc defines no message Encodr; did you mean Encoder?" in refuse(
        path, databases, "Encodr.Position"
    )
    assert "message Encoder has no signal Positon; did you mean Position?" in refuse(
        path, databases, "Encoder.Positon"
    )
    assert "names no signal; write it as Message.Signal" in refuse(path, databases, "Position")
    assert 'write column = "log time" and unit = "s"' in refuse(path, databases, unit="ms")


def test_a_state_is_no_number(log, databases):
    path = log(status_frames(T_S, 1, "Current", 327.67))
    said = refuse(path, databases, "Status.Current")
    assert "all its values have names (SNA): it is a state, and no number" in said


def test_a_value_that_is_no_number_is_named_with_its_frame(log, databases):
    frames = encoder_frames(T_S)
    frames[7].data = bytearray(np.float32(np.nan).tobytes() + bytes(4))
    assert "frame 8 of message Encoder holds nan" in refuse(log(frames), databases, POSITION)


# What a user of the tools of each kind calls the first two buses.
BUSES = {".blf": ("1", "2"), ".asc": ("1", "2"), ".log": ("can0", "can1"), ".trc": ("1", "2")}


@pytest.mark.parametrize("ending", BUSES)
def test_one_identifier_on_two_buses_needs_a_choice(tmp_path, databases, ending):
    others = encoder_frames(T_S + 0.003, channel=1)
    for message in others:
        message.data = bytearray(8)
    path = can_logs.write_log(tmp_path / f"run{ending}", [*encoder_frames(T_S), *others])
    first, second = BUSES[ending]
    said = refuse(path, databases, POSITION)
    assert f"comes on the buses {first}, {second}; state one as bus in [can]" in said
    chosen = read(path, databases, POSITION, bus=second).values[POSITION]
    assert chosen == pytest.approx(np.zeros(60))
    chosen = read(path, databases, POSITION, bus=first).values[POSITION]
    assert chosen == pytest.approx(np.sin(T_S), abs=1e-6)
    assert f"it has the buses {first}, {second}" in refuse(path, databases, POSITION, bus="can7")


def test_a_frame_that_repeats_a_stamp_is_left_out_as_in_bags(log, databases):
    frames = encoder_frames(T_S)
    frames.append(encoder_frames(T_S[7:8])[0])
    recording = read(log(frames), databases, POSITION)
    assert recording.notes == ("message Encoder: 1 messages repeat a stamp and are left out",)
    assert recording.t_s == pytest.approx(T_S, abs=WITHIN_S)


def test_without_a_database_it_says_what_is_needed(log):
    path = log(encoder_frames(T_S))
    said = refuse(path, ())
    assert 'state it in experiment.toml: databases = ["motor.dbc"] in [can]' in said
    with pytest.raises(BadInput, match=r"put its file \(\.dbc, \.kcd, \.sym, \.arxml\) into"):
        list_columns(path)


def test_without_cantools_it_says_what_to_type(log, databases, monkeypatch):
    path = log(encoder_frames(T_S))
    monkeypatch.setattr(recorded_files, "find_spec", lambda _: None)
    assert said_to_install(refuse(path, databases))
    with pytest.raises(BadInput, match=r"pip install 'rfca-rig\[canlogs\]'"):
        list_columns(path, databases)


def said_to_install(said):
    return "cantools, which decodes its frames, is not installed: pip install" in said


NO_DATABASES = {
    "empty.dbc": ('VERSION ""', "defines no messages of a CAN bus"),
    "junk.dbc": ("this is no database", "is no database of a CAN bus"),
    "junk.kcd": ("<a>", "is no database of a CAN bus"),
}


@pytest.mark.parametrize("name", NO_DATABASES)
def test_what_is_no_database_is_one_line(tmp_path, name):
    text, reason = NO_DATABASES[name]
    database = can_logs.write_database(tmp_path, text, name)
    path = can_logs.write_log(tmp_path / "run.blf", encoder_frames(T_S))
    said = refuse(path, [database])
    assert said.startswith(f"{database}: {reason}")
    assert len(said) < 500


def test_two_databases_are_one_unless_they_define_the_same(tmp_path, databases):
    other = can_logs.write_database(tmp_path, can_logs.DBC, "output.dbc")
    path = can_logs.write_log(tmp_path / "run.log", encoder_frames(T_S))
    assert "message Encoder (0x029) is also message Encoder (0x029) of motor.dbc" in refuse(
        path, [*databases, other]
    )
    alone = can_logs.DBC.split("BO_ 2147484160")[0].replace("BO_ 41 Encoder", "BO_ 42 Output")
    other = can_logs.write_database(tmp_path, alone, "output.dbc")
    assert read(path, [*databases, other], POSITION).values[POSITION].size == 60


def test_a_database_in_the_code_page_of_windows_is_read(tmp_path):
    text = can_logs.DBC.replace('"rad"', '"°"')
    path = can_logs.write_log(tmp_path / "run.log", encoder_frames(T_S))
    for encoding in ("cp1252", "utf-8"):
        database = tmp_path / f"{encoding}.dbc"
        database.write_bytes(text.encode(encoding))
        assert read(path, [database], POSITION).units[POSITION] == "°"


def test_databases_of_other_formats_are_read(tmp_path):
    database = tmp_path / "motor.kcd"
    database.write_text(can_logs.DATABASE.as_kcd_string(), encoding="utf-8")
    path = can_logs.write_log(tmp_path / "run.asc", torque_frames(T_S))
    recording = read(path, [database], TORQUE)
    assert recording.values[TORQUE] == pytest.approx(3.0 * np.cos(T_S), abs=6e-4)
    assert recording.units[TORQUE] == "Nm"


@pytest.mark.parametrize("share", [0.5, 0.97])
def test_a_log_that_was_cut_off_is_read_up_to_there(log, databases, share):
    path = log(encoder_frames(np.arange(0.0, 3.0, 0.001)))
    content = path.read_bytes()
    # In the middle of a line, or of a container.
    cut = int(share * len(content))
    if path.suffix != ".blf":
        cut = content.rindex(b"\n", 0, cut) + 6
    path.write_bytes(content[:cut])
    recording = read(path, databases, POSITION)
    assert 10 < len(recording.t_s) < 2990
    assert recording.values[POSITION] == pytest.approx(np.sin(recording.t_s), abs=1e-6)
    # A line of ASC or TRC that is no frame is skipped by python-can.
    if path.suffix in (".blf", ".log"):
        (note,) = recording.notes
        assert note.startswith("the end of the log is cut off; it is read up to there, ")


DAMAGED = {
    ".log": (b" can0 ", b" can0", "cannot be read as a CAN log (candump) after "),
    ".blf": (b"LOBJ", b"LOBK", "cannot be read as a CAN log (BLF) after 0 frames"),
}


@pytest.mark.parametrize("ending", DAMAGED)
def test_a_damaged_log_is_one_line(tmp_path, databases, ending):
    before, after, reason = DAMAGED[ending]
    frames = encoder_frames(T_S, channel="can0" if ending == ".log" else 0)
    path = can_logs.write_log(tmp_path / f"run{ending}", frames)
    content = path.read_bytes()
    middle = content.index(before, 0 if ending == ".blf" else len(content) // 2)
    path.write_bytes(content[:middle] + after + content[middle + len(before) :])
    said = refuse(path, databases)
    assert said.startswith(f"{path}: {reason}")


def test_a_log_without_frames_is_one_line(tmp_path, databases):
    path = tmp_path / "run.asc"
    path.write_text("date Wed May 01 12:00:00.000 2024\nbase hex  timestamps absolute\n")
    assert refuse(path, databases) == f"{path}: holds no frames with data"


def test_times_that_python_can_would_misread_are_refused(tmp_path, databases):
    path = can_logs.write_log(tmp_path / "run.asc", encoder_frames(T_S))
    text = path.read_text(encoding="latin-1")
    path.write_text(text.replace("timestamps absolute", "timestamps relative"))
    assert "save it with absolute timestamps" in refuse(path, databases)


def test_a_version_that_python_can_does_not_know_is_refused(tmp_path, databases):
    path = tmp_path / "run.trc"
    path.write_text(
        ";$FILEVERSION=3.0\n;$STARTTIME=45412.5\n  1)  1.5  0029  8  00 00 00 00 00 00 00 00\n"
    )
    assert "is a TRC file of version 3.0, which python-can does not read" in refuse(path, databases)


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_older_logs_of_peak_are_read(tmp_path, databases, version):
    lines = [";" + 74 * "#", ";    Start time: 30.04.2024 18:00:00.000.0"]
    if version == "1.1":
        lines = [";$FILEVERSION=1.1", ";$STARTTIME=45412.75", ";"]
    for number, t_s in enumerate(T_S, start=1):
        data = np.array([np.sin(t_s), 0.0], dtype=np.float32).tobytes().hex(" ").upper()
        direction = "  Rx  " if version == "1.1" else "  "
        lines.append(f"{number:6})  {1e3 * t_s:10.1f}{direction}0029  8  {data}")
    path = tmp_path / "run.trc"
    path.write_text("\n".join(lines) + "\n")
    recording = read(path, databases, POSITION)
    assert recording.t_s == pytest.approx(T_S, abs=WITHIN_S)
    assert recording.values[POSITION] == pytest.approx(np.sin(T_S), abs=1e-6)


@pytest.mark.parametrize(
    "line",
    [
        "  can0  029   [8]  BC 46 73 B9 B0 95 E5 BA",
        " (1714500000.000000)  can0  029   [8]  BC 46 73 B9 B0 95 E5 BA",
        " (2024-04-30 18:00:00.000000)  can0  RX - -  00000029   [8]  BC 46 73 B9 B0 95 E5 BA",
    ],
)
def test_what_candump_prints_on_the_screen_is_named(tmp_path, databases, line):
    path = tmp_path / "run.log"
    path.write_text(f"{line}\n" * 20)
    assert "record with candump -l" in refuse(path, databases)


def test_a_campaign_of_tables_says_that_a_log_is_none(tmp_path):
    campaign = copy_to(tmp_path)
    table = next(campaign.glob("runs/*.csv"))
    can_logs.write_log(tmp_path / "run.blf", encoder_frames(T_S)).rename(table)
    with pytest.raises(BadInput, match=r"is a CAN log \(BLF\); a table of text is needed here"):
        read_campaign(campaign)


EXPERIMENT = """format = "rfca-experiment/1"
title = "Cart on a bus"
model = "cart.xml"
[time]
column = "log time"
unit = "s"
[can]
databases = ["motor.dbc"]
[[signals]]
joint = "cart"
quantity = "position"
column = "Encoder.Position"
unit = "m"
[[commands]]
actuator = "push"
column = "Torque.Big"
unit = "N m"
[known_to]
mass_relative = 0.1
[[recordings]]
file = "run.log"
condition = "one"
"""


def write_experiment(folder):
    can_logs.write_database(folder)
    can_logs.write_log(folder / "run.log", [*encoder_frames(T_S), *torque_frames(T_S)])
    (folder / "cart.xml").write_text(MODEL, encoding="utf-8")
    (folder / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    return folder


def test_an_experiment_names_the_database(tmp_path):
    (run,) = read_experiment(write_experiment(tmp_path)).runs
    assert run.signals[:, 0] == pytest.approx(np.sin(T_S), abs=1e-6)
    assert [conflict.column for conflict in run.conflicts] == [POSITION]


def test_a_database_that_is_not_there_is_named_with_its_line(tmp_path):
    write_experiment(tmp_path)
    (tmp_path / "motor.dbc").unlink()
    with pytest.raises(BadInput, match=r"experiment\.toml:8: can\.databases: .*motor\.dbc is not"):
        read_experiment(tmp_path)


def test_a_database_elsewhere_behind_a_link_is_refused(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    write_experiment(folder)
    (folder / "motor.dbc").rename(tmp_path / "motor.dbc")
    (folder / "motor.dbc").symlink_to(tmp_path / "motor.dbc")
    with pytest.raises(BadInput, match="put a copy into the folder"):
        read_experiment(folder)
    assert read_experiment(folder, allow_outside=True).runs


def test_a_draft_lists_the_signals_and_names_the_database(tmp_path):
    folder = tmp_path / "recordings"
    folder.mkdir()
    write_experiment(folder)
    frames = [*encoder_frames(T_S), *encoder_frames(T_S + 0.001, channel=1)]
    can_logs.write_log(folder / "run.log", [*frames, raw_frame(0.5, 0x123, b"")])
    (folder / "notes.log").write_text("started at noon\n", encoding="utf-8")
    assert find_recordings(folder) == {"CAN log": [folder / "run.log"]}
    draft = drafted(folder)
    assert '[can]\ndatabases = ["motor.dbc"]' in draft
    assert 'column = "log time"\nunit = "s"' in draft
    assert "#   Encoder.Position: 0 to 0.5572\n" in draft
    assert "#   Encoder.Position: the database states the unit rad\n" in draft
    assert (
        "#   message Encoder: 120 frames on the buses can0, can1, of which can.bus names one"
        in draft
    )
    assert "1 frames that motor.dbc does not define are left out: 0x123" in draft
    assert "Torque" not in draft


def test_a_log_that_is_packed_is_named_with_the_way_out(log, databases):
    path = log(encoder_frames(T_S))
    packed = path.with_name(f"{path.name}.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert "packed by gzip; unpack it: gunzip" in refuse(packed, databases)


def test_every_kind_is_known_by_its_first_bytes(log, databases, tmp_path):
    path = log(encoder_frames(T_S))
    other = tmp_path / "recording.csv"
    path.rename(other)
    assert read(other, databases, POSITION).values[POSITION].size == 60
