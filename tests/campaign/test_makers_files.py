"""Files that the libraries of their makers write, three of each kind: of other types, units and
scales, with the values that went in.
"""

from pathlib import Path

import can
import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import find_recordings, list_columns, read_columns
from rfca_rig.errors import BadInput
from tests.campaign.drafts import MODEL, drafted

LEROBOT = Path(__file__).parents[1] / "data" / "lerobot"

SAMPLES = 60
T_S = 0.01 * np.arange(SAMPLES)
ANGLE = np.sin(30.0 * T_S)
TORQUE = 5.0 * np.cos(20.0 * T_S)
MOMENTS = np.datetime64("2024-05-01T12:00:00") + (1e6 * T_S).round().astype("timedelta64[us]")


def read(path, time, *columns, unit="s", episode=None, databases=()):
    holds = dict.fromkeys(columns, "the position of joint elbow")
    request = ColumnRequest(
        TimeSection(column=time, unit=unit), holds, 0.05, databases, episode=episode
    )
    return read_columns(path, request)


def assert_times(recording, times_s=T_S, within_s=1e-6):
    assert recording.t_s - recording.t_s[0] == pytest.approx(times_s, abs=within_s)


# npTDMS


def write_tdms(path, *segments):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for segment in segments:
            writer.write_segment(
                [nptdms.ChannelObject("Log", name, *channel) for name, channel in segment.items()]
            )
    return path


def test_tdms_with_counts_that_a_linear_scale_makes_newton_metres(tmp_path):
    scale = {
        "unit_string": "Nm",
        "NI_Scaling_Status": "unscaled",
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.001,
        "NI_Scale[0]_Linear_Y_Intercept": -1.0,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }
    counts = np.round((TORQUE + 1.0) / 0.001).astype(np.int16)
    path = write_tdms(
        tmp_path / "run.tdms", {"t": (T_S,), "Drehmoment [Nm]": (counts, scale), "n": ([],)}
    )
    recording = read(path, "Log/t", "Log/Drehmoment [Nm]")
    assert recording.values["Log/Drehmoment [Nm]"] == pytest.approx(TORQUE, abs=6e-4)
    assert recording.units == {"Log/Drehmoment [Nm]": "Nm"}


def test_tdms_with_dates_and_times_beside_text(tmp_path):
    path = write_tdms(
        tmp_path / "run.tdms",
        {"time": (MOMENTS,), "angle": (ANGLE.astype(np.float32),), "remark": (["a"] * SAMPLES,)},
    )
    recording = read(path, "Log/time", "Log/angle")
    assert_times(recording)
    assert recording.t_s[0] == pytest.approx(1714564800.0)
    assert recording.values["Log/angle"] == pytest.approx(ANGLE, abs=1e-6)
    assert "Log/time" in list_columns(path).times
    with pytest.raises(BadInput, match=r"Log/remark, which is to hold .*: it holds object, no num"):
        read(path, "Log/time", "Log/remark")


def test_tdms_of_several_segments_with_waveforms(tmp_path):
    waveform = {"wf_increment": 0.01, "wf_start_offset": 2.0, "wf_samples": 20}
    segments = [
        {
            "angle": (ANGLE[part : part + 20], {"unit_string": "rad", **waveform}),
            "count": (np.arange(part, part + 20, dtype=np.int64), waveform),
        }
        for part in (0, 20, 40)
    ]
    recording = read(
        write_tdms(tmp_path / "run.tdms", *segments), "Log/angle.time", "Log/angle", "Log/count"
    )
    assert_times(recording)
    assert recording.t_s[0] == pytest.approx(2.0)
    assert recording.values["Log/angle"] == pytest.approx(ANGLE)
    assert recording.values["Log/count"] == pytest.approx(np.arange(SAMPLES))


# asammdf

VERSIONS = {"3.30": ".mdf", "4.10": ".mf4"}


@pytest.fixture(params=VERSIONS)
def write_mdf(request, tmp_path):
    """Makes a measurement of both versions, of groups of signals."""
    asammdf = pytest.importorskip("asammdf")

    def write(*groups, **options):
        path = tmp_path / f"run{VERSIONS[request.param]}"
        with asammdf.MDF(version=request.param) as file:
            for group in groups:
                file.append([asammdf.Signal(name=name, **signal) for name, signal in group.items()])
            file.save(path, **options)
        return path

    return write


# What is stored of the torque, and the conversion that makes newton metres of it.
CONVERSIONS = {
    "linear": (np.round((TORQUE - 2.0) / 1e-3).astype(np.int16), {"a": 1e-3, "b": 2.0}),
    "rational": (
        np.round(TORQUE / 1e-4).astype(np.int32),
        {"P1": 0.0, "P2": 1.0, "P3": 0.0, "P4": 0.0, "P5": 0.0, "P6": 1e4},
    ),
    "formula": (np.round(TORQUE / 1e-3).astype(np.int32), {"formula": "X * 0.001"}),
}


@pytest.mark.parametrize("conversion", CONVERSIONS)
def test_mdf_with_a_conversion(write_mdf, conversion):
    asammdf = pytest.importorskip("asammdf")
    counts, rule = CONVERSIONS[conversion]
    made = asammdf.Signal(counts, T_S, name="check", conversion=rule).physical()
    assert made.samples == pytest.approx(TORQUE, abs=6e-4)
    path = write_mdf(
        {
            "torque": {"samples": counts, "timestamps": T_S, "unit": "Nm", "conversion": rule},
            "angle": {"samples": ANGLE.astype(np.float32), "timestamps": T_S, "unit": "rad"},
        }
    )
    recording = read(path, "0/time", "0/torque", "0/angle")
    assert_times(recording)
    assert recording.values["0/torque"] == pytest.approx(TORQUE, abs=6e-4)
    assert recording.values["0/angle"] == pytest.approx(ANGLE, abs=1e-6)
    assert recording.units == {"0/time": "s", "0/torque": "Nm", "0/angle": "rad"}


def test_mdf_of_several_groups_compressed(write_mdf):
    slow_s = T_S[::3]
    path = write_mdf(
        {"temperature": {"samples": slow_s.astype(np.float32), "timestamps": slow_s, "unit": "°C"}},
        {
            "angle": {"samples": ANGLE, "timestamps": 5.0 + T_S, "unit": "rad"},
            "count": {"samples": np.arange(SAMPLES, dtype=np.uint8), "timestamps": 5.0 + T_S},
            "state": {
                "samples": np.arange(SAMPLES) % 2,
                "timestamps": 5.0 + T_S,
                "conversion": {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"},
            },
        },
        compression=2,
    )
    recording = read(path, "1/time", "1/angle", "1/count")
    assert_times(recording)
    assert recording.values["1/angle"] == pytest.approx(ANGLE)
    assert recording.values["1/count"] == pytest.approx(np.arange(SAMPLES))
    with pytest.raises(BadInput, match="0/temperature has 20 samples and 1/time has 60"):
        read(path, "1/time", "1/angle", "0/temperature")
    with pytest.raises(BadInput, match=r"1/state, which is to hold .*: it holds .*, no numbers"):
        read(path, "1/time", "1/angle", "1/state")


def test_invalid_samples_of_an_mdf_are_left_out_with_a_note(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    is_invalid = np.arange(SAMPLES) % 10 == 3
    path = tmp_path / "run.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append(
            [
                asammdf.Signal(ANGLE, T_S, name="angle", invalidation_bits=is_invalid),
                asammdf.Signal(TORQUE, T_S, name="torque"),
            ]
        )
        file.save(path)
    recording = read(path, "0/time", "0/angle", "0/torque")
    assert recording.notes == ("6 samples that the file marks as invalid, or names, are left out",)
    assert recording.t_s == pytest.approx(T_S[~is_invalid])
    assert recording.values["0/angle"] == pytest.approx(ANGLE[~is_invalid])
    assert recording.values["0/torque"] == pytest.approx(TORQUE[~is_invalid])
    assert not read(path, "0/time", "0/torque").notes
    assert len(read(path, "0/time", "0/torque").t_s) == SAMPLES


def test_values_of_an_mdf_that_have_names_are_left_out_with_a_note(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    from asammdf.blocks.conversion_utils import from_dict

    counts = np.round(TORQUE / 1e-3).astype(np.int16)
    counts[5:8] = 32767
    rule = from_dict(
        {"val_0": 32767, "text_0": b"SNA", "default_addr": {"a": 1e-3, "b": 0.0}},
    )
    path = tmp_path / "run.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(counts, T_S, name="torque", unit="Nm", conversion=rule)])
        file.save(path)
    recording = read(path, "0/time", "0/torque")
    is_named = counts == 32767
    assert recording.notes == ("3 samples that the file marks as invalid, or names, are left out",)
    assert recording.values["0/torque"] == pytest.approx(TORQUE[~is_named], abs=6e-4)


def test_channels_of_one_name_in_a_group_are_numbered(write_mdf):
    asammdf = pytest.importorskip("asammdf")
    path = write_mdf({"angle": {"samples": ANGLE, "timestamps": T_S}})
    with asammdf.MDF(path) as file:
        version = file.version
    with asammdf.MDF(version=version) as file:
        file.append([asammdf.Signal(values, T_S, name="angle") for values in (ANGLE, TORQUE)])
        file.save(path, overwrite=True)
    recording = read(path, "0/time", "0/angle (1)", "0/angle (2)")
    assert recording.values["0/angle (1)"] == pytest.approx(ANGLE)
    assert recording.values["0/angle (2)"] == pytest.approx(TORQUE)
    with pytest.raises(BadInput, match=r"0/angle, .* is missing; did you mean 0/angle \("):
        read(path, "0/time", "0/angle")


# python-can; tests/campaign/test_can_logs.py has more of it.

CAN_CONTENTS = {
    "floats": ("Encoder.Position", "rad"),
    "scaled integers of both byte orders": ("Torque.Big", "Nm"),
    "signals that share bytes": ("Status.Temperature", "degC"),
}


@pytest.mark.parametrize("content", CAN_CONTENTS)
@pytest.mark.parametrize("writer", [can.BLFWriter, can.ASCWriter, can.CanutilsLogWriter, "1", "2"])
def test_can_logs(tmp_path, content, writer):
    pytest.importorskip("cantools")
    from can.io.trc import TRCFileVersion

    from tests.campaign import can_logs

    column, unit = CAN_CONTENTS[content]
    name, signal = column.split(".")
    values = {"Position": ANGLE, "Big": TORQUE, "Temperature": 10.0 * ANGLE}[signal]
    others = {"Encoder": {"Velocity": 0.0}, "Torque": {"Little": 1.0}, "Status": {"Page": 0}}[name]
    path = tmp_path / "run.log"
    if isinstance(writer, str):
        log = can.TRCWriter(path)
        log.file_version = {"1": TRCFileVersion.V1_0, "2": TRCFileVersion.V2_1}[writer]
    else:
        log = writer(path)
    with log:
        for t_s, value in zip(T_S, values, strict=True):
            message = can_logs.frame(t_s, name, {signal: float(value), **others})
            message.timestamp += can_logs.BEGIN_S
            log.on_message_received(message)
    databases = [can_logs.write_database(tmp_path)]
    recording = read(path, "log time", column, databases=databases)
    assert_times(recording)
    resolution = {"Position": 1e-6, "Big": 6e-5, "Temperature": 0.051}[signal]
    assert recording.values[column] == pytest.approx(values, abs=resolution)
    assert recording.units[column] == unit


# rosbags; tests/campaign/test_ros_bags.py and test_bag_columns.py have more of it.


def make_ros_messages(store):
    """Messages of three types, the column of each, and its values."""
    header = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    vector = store.types["geometry_msgs/msg/Vector3"]
    is_ros_1 = "seq" in header.__dataclass_fields__

    def make_header(t_s):
        ns = 1_714_500_000_000_000_000 + round(1e9 * t_s)
        stamp = time(ns // 1_000_000_000, ns % 1_000_000_000)
        return header(0, stamp, "") if is_ros_1 else header(stamp, "")

    def joints(t_s, value):
        empty = np.zeros(0)
        make = store.types["sensor_msgs/msg/JointState"]
        return make(make_header(t_s), ["elbow"], np.array([value]), empty, empty)

    def imu(t_s, value):
        turn = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        unknown = np.zeros(9)
        return store.types["sensor_msgs/msg/Imu"](
            make_header(t_s),
            turn,
            unknown,
            vector(0.0, value, 0.0),
            unknown,
            vector(0.0, 0.0, 9.81),
            unknown,
        )

    def temperature(t_s, value):
        return store.types["sensor_msgs/msg/Temperature"](make_header(t_s), value, 0.0)

    return {
        "/joints:position[elbow]": ("sensor_msgs/msg/JointState", joints, ANGLE),
        "/imu:angular_velocity.y": ("sensor_msgs/msg/Imu", imu, TORQUE),
        "/motor:temperature": ("sensor_msgs/msg/Temperature", temperature, 20.0 + ANGLE),
    }


@pytest.mark.parametrize("column", [0, 1, 2])
@pytest.mark.parametrize("kind", ["ROS 1", "sqlite3", "mcap"])
def test_bags(tmp_path, kind, column):
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if kind == "ROS 1":
        store = get_typestore(Stores.ROS1_NOETIC)
        path = tmp_path / "run.bag"
        writer = Ros1Writer(path)
        serialize = store.serialize_ros1
    else:
        store = get_typestore(Stores.ROS2_HUMBLE)
        path = tmp_path / "run"
        storage = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[kind]
        writer = Writer(path, version=9, storage_plugin=storage)
        serialize = store.serialize_cdr
    name, (type_name, make, values) = list(make_ros_messages(store).items())[column]
    with writer:
        connection = writer.add_connection(name.split(":")[0], type_name, typestore=store)
        for t_s, value in zip(T_S, values, strict=True):
            writer.write(
                connection,
                1_714_500_000_000_000_000 + round(1e9 * t_s),
                bytes(serialize(make(t_s, float(value)), type_name)),
            )
    recording = read(path, "header.stamp", name)
    assert_times(recording)
    assert recording.values[name] == pytest.approx(values)


# pyarrow, as pandas and others use it


def write_parquet(path, **columns):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(columns), path)
    return path


def test_parquet_with_dates_and_decimals(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from decimal import Decimal

    path = write_parquet(
        tmp_path / "run.parquet",
        time=pyarrow.array(MOMENTS, type=pyarrow.timestamp("us", tz="UTC")),
        since=pyarrow.array((1e3 * T_S).round().astype("timedelta64[ms]")),
        torque=pyarrow.array([Decimal(f"{value:.6f}") for value in TORQUE]),
    )
    recording = read(path, "time", "since", "torque")
    assert_times(recording)
    assert recording.t_s[0] == pytest.approx(1714564800.0)
    assert recording.values["since"] == pytest.approx(T_S)
    assert recording.values["torque"] == pytest.approx(TORQUE, abs=1e-6)
    assert recording.units == {"time": "s", "since": "s"}


def test_parquet_with_integers_of_ns_and_missing_values(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    begin_ns = 1_714_500_000_000_000_000
    path = write_parquet(
        tmp_path / "run.parquet",
        stamp=pyarrow.array([begin_ns + round(1e9 * t) for t in T_S]),
        angle=pyarrow.array(ANGLE.astype(np.float16)),
        gap=pyarrow.array([None if k == 7 else k for k in range(SAMPLES)]),
    )
    recording = read(path, "stamp", "angle", unit="ns")
    assert_times(recording)
    assert recording.values["angle"] == pytest.approx(ANGLE, abs=1e-3)
    with pytest.raises(BadInput, match="column gap: sample 8 is nan"):
        read(path, "stamp", "gap", unit="ns")


def test_parquet_with_lists_of_any_kind(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    pairs = np.column_stack([ANGLE, TORQUE])
    path = write_parquet(
        tmp_path / "run.parquet",
        t=pyarrow.array(T_S),
        plain=pyarrow.array(pairs.tolist()),
        large=pyarrow.array(pairs.tolist(), type=pyarrow.large_list(pyarrow.float32())),
        fixed=pyarrow.array(pairs.tolist(), type=pyarrow.list_(pyarrow.float64(), 2)),
        ragged=pyarrow.array([[0.0] * (1 + k % 2) for k in range(SAMPLES)]),
    )
    recording = read(path, "t", "plain[1]", "large[0]", "fixed[1]")
    assert recording.values["plain[1]"] == pytest.approx(TORQUE)
    assert recording.values["large[0]"] == pytest.approx(ANGLE, abs=1e-6)
    assert recording.values["fixed[1]"] == pytest.approx(TORQUE)
    with pytest.raises(BadInput, match=r"column ragged.*is missing"):
        read(path, "t", "ragged")


# LeRobot's own writer made these; see tests/data/lerobot/README.md.

FILE = "data/chunk-000/file-000.parquet"


def test_lerobot_with_several_episodes_in_a_file():
    pytest.importorskip("pyarrow")
    path = LEROBOT / "arm" / FILE
    t_s = np.arange(90) / 30.0
    for episode in (0, 1):
        columns = ("observation.state[0]", "observation.state[1]", "action[0]")
        recording = read(path, "timestamp", *columns, episode=episode)
        assert_times(recording, t_s)
        first, second, action = (recording.values[column] for column in columns)
        assert first == pytest.approx(10.0 * np.sin(3.0 * t_s) + episode, abs=1e-5)
        assert second == pytest.approx(20.0 * np.cos(3.0 * t_s), abs=1e-5)
        assert action == pytest.approx(5.0 * np.cos(3.0 * t_s), abs=1e-5)
    with pytest.raises(BadInput, match=r"holds the episodes 0 to 1; state one in \[\[recordings\]"):
        read(path, "timestamp", "action[0]")
    with pytest.raises(BadInput, match="holds no episode 2, but 0 to 1"):
        read(path, "timestamp", "action[0]", episode=2)


def test_lerobot_with_one_joint_is_a_column_without_brackets():
    pytest.importorskip("pyarrow")
    path = LEROBOT / "hinge" / FILE
    t_s = np.arange(100) / 50.0
    recording = read(path, "timestamp", "observation.state", "action", "observation.current")
    assert_times(recording, t_s)
    assert recording.values["observation.state"] == pytest.approx(np.sin(3.0 * t_s))
    assert recording.values["action"] == pytest.approx(np.cos(3.0 * t_s), abs=1e-6)
    current = recording.values["observation.current"]
    assert current == pytest.approx(1000.0 * np.cos(3.0 * t_s), abs=0.51)
    assert list_columns(path).labels == {
        "observation.state": "elbow.pos",
        "observation.current": "mA",
    }


def test_lerobot_with_names_by_their_kind():
    pytest.importorskip("pyarrow")
    path = LEROBOT / "pair" / FILE
    t_s = np.arange(60) / 60.0
    recording = read(path, "timestamp", "observation.state[1]", "action[1]", episode=2)
    assert_times(recording, t_s)
    assert recording.values["observation.state[1]"] == pytest.approx(-np.sin(3.0 * t_s), abs=1e-6)
    assert recording.values["action[1]"] == pytest.approx(np.full(60, 2.0))
    assert list_columns(path).labels["observation.state[1]"] == "right"


def copy_data_set(name, folder):
    """A data set, whose files are written anew: they may be links in an installed copy."""
    for file in (LEROBOT / name).rglob("*"):
        if file.is_file():
            copy = folder / file.relative_to(LEROBOT / name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(file.read_bytes())
    return folder


def test_a_draft_of_a_data_set_names_joints_and_episodes(tmp_path):
    pytest.importorskip("pyarrow")
    folder = copy_data_set("arm", tmp_path / "arm")
    # Its tables of episodes and tasks are no recordings.
    assert find_recordings(folder) == {"logger": [folder / FILE]}
    draft = drafted(folder)
    assert "#   observation.state[2] (gripper.pos): 1 to 1\n" in draft
    assert "#   timestamp: 0 to 2.967\n" in draft
    assert '[time]\ncolumn = "timestamp"\nunit = "s"\n' in draft
    assert draft.count(f'file = "{FILE}"') == 2
    assert 'condition = "recording 2"\nepisode = 1\n' in draft


def test_an_experiment_names_an_episode(tmp_path):
    pytest.importorskip("pyarrow")
    folder = copy_data_set("arm", tmp_path / "arm")
    (folder / "cart.xml").write_text(MODEL, encoding="utf-8")
    (folder / "experiment.toml").write_text(
        f"""format = "rfca-experiment/1"
title = "Cart"
model = "cart.xml"
[time]
column = "timestamp"
unit = "s"
[[signals]]
joint = "cart"
quantity = "position"
column = "observation.state[0]"
unit = "m"
[known_to]
mass_relative = 0.1
[windows]
bin_s = 0.1
[[recordings]]
file = "{FILE}"
episode = 0
condition = "one"
driven = false
[[recordings]]
file = "{FILE}"
episode = 1
condition = "two"
driven = false
""",
        encoding="utf-8",
    )
    first, second = read_experiment(folder).runs
    assert second.signals == pytest.approx(first.signals + 1.0, abs=1e-5)
    path = folder / "experiment.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("episode = 1", "episode = 0"))
    with pytest.raises(BadInput, match=r"episode 0 is already recordings\[1\]"):
        read_experiment(folder)


def test_an_episode_of_a_file_without_any_is_refused(tmp_path):
    (tmp_path / "run.csv").write_text("t,q\n0,0\n1,1\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"is one recording; remove episode = 3"):
        read(tmp_path / "run.csv", "t", "q", episode=3)
    path = write_parquet(tmp_path / "run.parquet", t=T_S, q=ANGLE)
    with pytest.raises(BadInput, match="has no column episode_index; remove episode = 3"):
        read(path, "t", "q", episode=3)


def test_a_description_of_a_data_set_that_is_no_json_is_one_line(tmp_path):
    pytest.importorskip("pyarrow")
    folder = copy_data_set("arm", tmp_path / "arm")
    (folder / "meta" / "info.json").write_text("{", encoding="utf-8")
    with pytest.raises(BadInput, match=r"info\.json: is no JSON"):
        list_columns(folder / FILE)
    (folder / "meta" / "info.json").write_text('{"features": [1]}', encoding="utf-8")
    assert list_columns(folder / FILE).labels == {}
