"""Bags of ROS 1, and compressed bags of ROS 2, as rosbags writes them: the same columns and values
as those of plain bags.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import find_recordings, list_columns, read_columns
from rfca_rig.errors import BadInput
from rfca_rig.executors.parallel import CAN_COPY
from rfca_rig.executors.reading import MEMORY_VARIABLE, TIME_VARIABLE, read_within_limits
from tests.campaign import bags
from tests.campaign.small import copy_to

T_S = 0.01 * np.arange(50)
ELBOW = "/joint_states:position[elbow]"
FORCE = "/wrench:wrench.force.z"
MOTORS = "my_robot/msg/Motors"

STORE_1 = get_typestore(Stores.ROS1_NOETIC)
STORE_1.register(get_types_from_msg("time stamp\nfloat64[3] torque_Nm\nchar state\n", MOTORS))


def read(path, *columns, time="header.stamp"):
    holds = dict.fromkeys(columns or (ELBOW, FORCE), "the position of joint elbow")
    return read_columns(path, ColumnRequest(TimeSection(column=time, unit="s"), holds, 0.05))


def refuse(path, *columns, **options):
    with pytest.raises(BadInput) as refused:
        read(path, *columns, **options)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def assert_read(recording):
    assert recording.t_s == pytest.approx(T_S, abs=1e-9)
    assert recording.values[ELBOW] == pytest.approx(2.0 * T_S)
    assert recording.values[FORCE] == pytest.approx(100.0 * T_S)


def stamp_1(t_s):
    ns = bags.ns_of(t_s)
    return STORE_1.types["builtin_interfaces/msg/Time"](ns // bags.NS, ns % bags.NS)


def joint_state_1(t_s):
    header = STORE_1.types["std_msgs/msg/Header"](round(100 * t_s), stamp_1(t_s), "base")
    positions = np.array([t_s, 2.0 * t_s])
    names = ["shoulder", "elbow"]
    return STORE_1.types[bags.JOINT_STATE](header, names, positions, np.zeros(2), np.zeros(2))


def wrench_1(t_s):
    vector = STORE_1.types["geometry_msgs/msg/Vector3"]
    wrench = STORE_1.types["geometry_msgs/msg/Wrench"](
        vector(0.0, 0.0, 100.0 * t_s), vector(0.0, 0.0, 0.0)
    )
    header = STORE_1.types["std_msgs/msg/Header"](round(100 * t_s), stamp_1(t_s), "base")
    return STORE_1.types[bags.WRENCH](header, wrench)


def motors_1(t_s):
    return STORE_1.types[MOTORS](stamp_1(t_s), np.array([t_s, -t_s, 3.0 * t_s]), 7)


TOPICS = {
    "/joint_states": (bags.JOINT_STATE, joint_state_1),
    "/wrench": (bags.WRENCH, wrench_1),
    "/motors": (MOTORS, motors_1),
}


def write_ros_1_bag(path, compression=None, times_s=T_S):
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    # Several chunks.
    writer.chunk_threshold = 4000
    with writer:
        connections = {
            topic: writer.add_connection(topic, type_name, typestore=STORE_1)
            for topic, (type_name, _) in TOPICS.items()
        }
        for t_s in times_s:
            for topic, (type_name, make) in TOPICS.items():
                data = STORE_1.serialize_ros1(make(t_s), type_name)
                writer.write(connections[topic], bags.ns_of(t_s + 0.001), bytes(data))
    return path


@pytest.mark.parametrize(
    "compression", [None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4]
)
def test_a_bag_of_ros_1_has_the_columns_of_ros_2(tmp_path, compression):
    path = write_ros_1_bag(tmp_path / "run.bag", compression)
    assert_read(read(path))
    motors = read(path, "/motors:torque_Nm[2]", "/motors:state", time="stamp")
    assert motors.values["/motors:torque_Nm[2]"] == pytest.approx(3.0 * T_S)
    assert motors.values["/motors:state"] == pytest.approx(np.full(50, 7.0))
    logged = read(path, FORCE, time="log time")
    assert logged.t_s == pytest.approx(T_S, abs=1e-9)


def test_a_list_of_a_bag_of_ros_1_is_that_of_ros_2(tmp_path):
    path = write_ros_1_bag(tmp_path / "run.bag")
    assert find_recordings(tmp_path) == {"bag": [path]}
    listed = list_columns(path)
    assert "topic /joint_states: sensor_msgs/msg/JointState, 50 messages" in listed.notes
    assert "topic /motors: my_robot/msg/Motors, 50 messages" in listed.notes
    assert listed.values[ELBOW] == pytest.approx(2.0 * T_S)
    assert listed.values["/motors:torque_Nm[1]"] == pytest.approx(-T_S)
    # The messages of motors have a stamp and no header.
    assert listed.times == ()


def test_a_bag_of_ros_1_is_known_by_its_first_bytes(tmp_path):
    path = write_ros_1_bag(tmp_path / "run.bag").rename(tmp_path / "run.data")
    assert_read(read(path))
    campaign = copy_to(tmp_path)
    path.rename(next(campaign.glob("runs/*.csv")))
    with pytest.raises(BadInput, match="column t_s is missing; the file has log time"):
        read_campaign(campaign)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda content: content[: len(content) // 2], "`rosbag reindex` saves what it can"),
        (lambda content: content[:20], "`rosbag reindex` saves what it can"),
        (lambda content: content.replace(b"V2.0", b"V1.2", 1), "Bag version 102 is not supported."),
    ],
)
def test_a_damaged_bag_of_ros_1_is_one_line(tmp_path, damage, reason):
    path = write_ros_1_bag(tmp_path / "run.bag")
    path.write_bytes(damage(path.read_bytes()))
    said = refuse(path)
    assert said.startswith(f"{path}: cannot be read as a bag: ")
    assert said.endswith(reason)


def test_what_is_named_bag_and_is_none_is_one_line(tmp_path):
    path = tmp_path / "run.bag"
    path.write_bytes(b"nothing of the kind" * 100)
    assert "cannot be read as a bag: " in refuse(path)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_messages_of_ros_1_in_an_mcap_file_are_read(tmp_path, compression):
    """As `mcap convert` makes it of a bag."""
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start(profile="ros1")
        for topic, (type_name, make) in TOPICS.items():
            definition, _ = STORE_1.generate_msgdef(type_name)
            name = type_name.replace("/msg/", "/")
            schema = writer.register_schema(name, "ros1msg", definition.encode())
            channel = writer.register_channel(topic, "ros1", schema)
            for t_s in T_S:
                data = bytes(STORE_1.serialize_ros1(make(t_s), type_name))
                writer.add_message(channel, bags.ns_of(t_s), data, bags.ns_of(t_s))
        writer.finish()
    assert_read(read(path))
    assert read(path, "/motors:torque_Nm[0]", time="stamp").t_s == pytest.approx(T_S, abs=1e-9)


def write_compressed(folder, storage, mode):
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    states = [(t, bags.joint_state(t, ("shoulder", "elbow"), [t, 2.0 * t])) for t in T_S]
    wrenches = [(t, bags.wrench(t, 100.0 * t)) for t in T_S]
    with writer:
        for topic, type_name, messages in (
            ("/joint_states", bags.JOINT_STATE, states),
            ("/wrench", bags.WRENCH, wrenches),
        ):
            connection = writer.add_connection(topic, type_name, typestore=bags.STORE)
            for t_s, message in messages:
                data = bags.STORE.serialize_cdr(message, type_name)
                writer.write(connection, bags.ns_of(t_s), data)
    return folder


COMPRESSED = [
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    (StoragePlugin.MCAP, CompressionMode.FILE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
]


@pytest.mark.parametrize(("storage", "mode"), COMPRESSED)
def test_a_compressed_bag_is_read(tmp_path, monkeypatch, storage, mode):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    folder = write_compressed(tmp_path / "run", storage, mode)
    suffixes = {file.suffix for file in folder.iterdir()}
    assert (".zstd" in suffixes) == (mode is CompressionMode.FILE)
    assert_read(read(folder))
    assert list_columns(folder).values[ELBOW] == pytest.approx(2.0 * T_S)
    assert find_recordings(tmp_path) == {"bag": [folder]}
    # Nothing that was unpacked stays.
    assert not list(scratch.iterdir())


@pytest.mark.parametrize("compression", list(CompressionType))
def test_an_mcap_file_with_compressed_chunks_is_read(tmp_path, compression):
    fields = [(t, {"q": t, "padding": "x" * 200}) for t in T_S]
    path = bags.write_mcap(tmp_path / "run.mcap", {"/state": fields}, compression=compression)
    recording = read(path, "/state:q", time="log time")
    assert recording.values["/state:q"] == pytest.approx(T_S)


def test_a_compressed_file_of_a_bag_alone_is_named_with_the_way_out(tmp_path):
    folder = write_compressed(tmp_path / "run", StoragePlugin.SQLITE3, CompressionMode.FILE)
    (path,) = folder.glob("*.zstd")
    said = refuse(path)
    assert "is compressed by zstd; unpack it: zstd -d; of a ROS 2 bag give the folder" in said


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_file_of_compressed_messages_alone_is_named_with_the_way_out(tmp_path, storage):
    folder = write_compressed(tmp_path / "run", storage, CompressionMode.MESSAGE)
    (path,) = folder.glob("run*.*")
    assert "its messages are compressed by zstd; give the folder of the bag" in refuse(path)


def test_a_damaged_compressed_file_is_one_line(tmp_path):
    folder = write_compressed(tmp_path / "run", StoragePlugin.SQLITE3, CompressionMode.FILE)
    (path,) = folder.glob("*.zstd")
    path.write_bytes(path.read_bytes()[:200])
    assert refuse(folder).startswith(f"{folder}: cannot be read as a bag: ")


@pytest.mark.skipif(not CAN_COPY, reason="files are read in this process")
def test_a_small_file_that_unpacks_to_a_large_one_is_refused(tmp_path, monkeypatch):
    folder = write_compressed(tmp_path / "run", StoragePlugin.SQLITE3, CompressionMode.FILE)
    (path,) = folder.glob("*.zstd")
    path.write_bytes(pack_zeros(300_000_000))
    assert path.stat().st_size < 1_000_000
    monkeypatch.setenv(MEMORY_VARIABLE, "0.25")
    assert "cannot be read within 0.25 GiB of memory" in refuse(folder)


@pytest.mark.skipif(not CAN_COPY, reason="files are read in this process")
def test_what_a_killed_copy_unpacked_is_removed(tmp_path, monkeypatch):
    def unpack_without_end():
        tempfile.mkdtemp()
        time.sleep(60.0)

    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.setenv(TIME_VARIABLE, "0.5")
    with pytest.raises(BadInput, match=r"takes more than 0\.5 s to read"):
        read_within_limits(tmp_path, unpack_without_end)
    assert not list(scratch.iterdir())


def pack_zeros(count):
    zstandard = pytest.importorskip("zstandard")
    return zstandard.ZstdCompressor().compress(bytes(count))


def test_the_scratch_folder_is_that_of_the_system_afterwards(tmp_path):
    before = tempfile.gettempdir()
    read(write_ros_1_bag(tmp_path / "run.bag"))
    assert Path(tempfile.gettempdir()) == Path(before)
