"""Recordings in MCAP files and ROS 2 bags: fields of messages as columns over one time base, and
every fault in one line.
"""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rfca_rig.campaign import recorded_files
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import find_recordings, list_columns, read_columns
from rfca_rig.errors import BadInput
from rfca_rig.export.mcap_file import export_mcap
from rfca_rig.progress import ignore_progress
from tests.campaign import bags
from tests.campaign.drafts import drafted
from tests.campaign.small import SMALL

T_S = 0.01 * np.arange(50)
JOINTS = ("shoulder", "elbow")
FORCE = "/wrench:wrench.force.z"
MOTORS = "my_robot/msg/Motors"


def states(times_s=T_S, names=JOINTS):
    """Messages whose joints stand at (t, 2 t, ...); speeds were not measured."""
    return [(t, bags.joint_state(t, names, t * np.arange(1, len(names) + 1))) for t in times_s]


def forces(times_s):
    return [(t, bags.wrench(t, 100.0 * t)) for t in times_s]


def topics(joint_states=None, wrenches=None):
    return {
        "/joint_states": (bags.JOINT_STATE, states() if joint_states is None else joint_states),
        "/wrench": (bags.WRENCH, forces(T_S) if wrenches is None else wrenches),
    }


def read(path, *columns, time="header.stamp", unit="s", longest_gap_s=0.05):
    holds = dict.fromkeys(
        columns or ("/joint_states:position[elbow]", FORCE), "the position of joint elbow"
    )
    return read_columns(
        path, ColumnRequest(TimeSection(column=time, unit=unit), holds, longest_gap_s)
    )


def refusal(path, *columns, **options):
    with pytest.raises(BadInput) as refused:
        read(path, *columns, **options)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(path))
    return str(refused.value)


@pytest.fixture(params=["sqlite3", "mcap", "db3 file", "mcap file"])
def bag(request, tmp_path):
    """Makes the same bag in each form that ROS 2 has."""

    def write(content, **options):
        if request.param.startswith("mcap"):
            storage = StoragePlugin.MCAP
        else:
            storage = StoragePlugin.SQLITE3
        folder = bags.write_rosbag(tmp_path / "run", content, storage, **options)
        if request.param.endswith("file"):
            return next(folder.glob("run*.*"))
        return folder

    return write


def test_fields_of_ros_messages_are_columns_by_name_and_by_number(bag):
    path = bag(topics())
    found = read(path, "/joint_states:position[elbow]", "/joint_states:position[0]", FORCE)
    assert found.t_s == pytest.approx(T_S, abs=1e-9)
    assert found.values["/joint_states:position[elbow]"] == pytest.approx(2.0 * T_S)
    assert found.values["/joint_states:position[0]"] == pytest.approx(T_S)
    assert found.values[FORCE] == pytest.approx(100.0 * T_S)


def test_stamps_are_read_and_not_the_log_unless_asked_for(bag):
    """Logged with a delay that grows: its times are further apart than the stamps."""
    path = bag(
        {"/joint_states": (bags.JOINT_STATE, [(2.0 * t, message) for t, message in states()])}
    )
    assert read(path, "/joint_states:position[0]").t_s == pytest.approx(T_S, abs=1e-9)
    assert read(path, "/joint_states:position[0]", time="log time").t_s == pytest.approx(
        2.0 * T_S, abs=1e-9
    )


def test_topics_of_other_rates_are_interpolated_to_the_first_signal_where_all_overlap(bag):
    path = bag(topics(wrenches=forces(np.arange(0.123, 0.4, 0.007))))
    found = read(path)
    assert found.t_s[[0, -1]] == pytest.approx([0.13, 0.39])
    assert np.diff(found.t_s) == pytest.approx(0.01)
    assert found.values[FORCE] == pytest.approx(100.0 * found.t_s)
    assert found.values["/joint_states:position[elbow]"] == pytest.approx(2.0 * found.t_s)


def test_a_gap_of_any_topic_is_left_out_and_so_remains_a_gap(bag):
    path = bag(topics(wrenches=forces(T_S[(T_S < 0.195) | (T_S > 0.255)])))
    found = read(path)
    assert np.diff(found.t_s).max() == pytest.approx(0.07)
    assert not ((found.t_s > 0.1901) & (found.t_s < 0.2599)).any()
    assert len(read(path, longest_gap_s=0.08).t_s) == len(T_S)


def test_joints_that_come_in_messages_of_their_own_are_put_together(bag):
    """As with a gripper whose driver publishes on the same topic as that of the arm."""
    both = sorted([*states(), *states(T_S + 0.003, names=("finger",))], key=lambda one: one[0])
    found = read(
        bag(topics(joint_states=both)),
        "/joint_states:position[elbow]",
        "/joint_states:position[finger]",
    )
    assert found.values["/joint_states:position[elbow]"] == pytest.approx(2.0 * found.t_s, abs=1e-9)
    assert found.values["/joint_states:position[finger]"] == pytest.approx(found.t_s, abs=1e-9)
    assert len(found.t_s) == len(T_S) - 1


IDL = """================================================================================
IDL: my_robot/msg/Motors
module my_robot { module msg { struct Motors { double torque_Nm[3]; uint32 count; }; }; };
"""


@pytest.mark.parametrize(
    "definition", [{}, {"msgdef": IDL, "rihs01": "RIHS01_00"}], ids=["msg", "idl"]
)
def test_a_message_type_that_only_the_bag_defines_is_read(bag, definition):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64[3] torque_Nm\nuint32 count\n", MOTORS))
    messages = [(t, store.types[MOTORS](np.array([0.0, t, 2.0 * t]), round(t / 0.01))) for t in T_S]
    path = bag({"/motors": (MOTORS, messages)}, store=store, **definition)
    found = read(path, "/motors:torque_Nm[2]", "/motors:count", time="log time")
    assert found.values["/motors:torque_Nm[2]"] == pytest.approx(2.0 * T_S)
    assert found.values["/motors:count"] == pytest.approx(np.arange(50))


def forget_definitions(folder):
    """Makes a bag one from before ROS 2 Iron, when bags held no definitions."""
    with closing(sqlite3.connect(folder / f"{folder.name}.db3")) as database:
        database.executescript(
            "DROP TABLE message_definitions; UPDATE schema SET schema_version = 3;"
        )
    return folder


def test_a_bag_without_definitions_is_read_with_those_of_ros(tmp_path):
    path = forget_definitions(bags.write_rosbag(tmp_path / "run", topics()))
    assert read(path).values[FORCE] == pytest.approx(100.0 * T_S)


def test_a_type_that_neither_the_bag_nor_ros_defines_is_one_line(tmp_path):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 torque_Nm\n", MOTORS))
    messages = [(t, store.types[MOTORS](t)) for t in T_S]
    path = forget_definitions(
        bags.write_rosbag(tmp_path / "run", {"/motors": (MOTORS, messages)}, store=store)
    )
    said = refusal(path, "/motors:torque_Nm", time="log time")
    assert (
        "topic /motors: the bag does not define my_robot/msg/Motors; record it with mcap storage"
        in said
    )


def test_json_messages_are_read_with_times_of_their_own(tmp_path):
    fields = [
        (
            t,
            {
                "tick": 5000 + round(1000 * t),
                "arm": {"q": [t, -t]},
                "name": ["a", "b"],
                "angle": [t, 3.0 * t],
            },
        )
        for t in T_S
    ]
    path = bags.write_mcap(tmp_path / "run.mcap", {"/state": fields})
    found = read(path, "/state:arm.q[1]", "/state:angle[b]", time="tick", unit="ms")
    assert found.t_s == pytest.approx(T_S)
    assert found.values["/state:arm.q[1]"] == pytest.approx(-T_S)
    assert found.values["/state:angle[b]"] == pytest.approx(3.0 * T_S)


def test_stamps_as_foxglove_writes_them_in_json_are_read(tmp_path):
    fields = [(0.5 + t, {"timestamp": {"sec": 7, "nsec": round(1e9 * t)}, "q": t}) for t in T_S]
    path = bags.write_mcap(tmp_path / "run.mcap", {"/state": fields})
    assert read(path, "/state:q", time="timestamp").t_s == pytest.approx(T_S)


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("/joint_state:position[0]", "there is no topic /joint_state; did you mean /joint_states?"),
        (
            "position",
            (
                "column position, which is to hold the position of joint elbow, names no "
                "field; write it as topic:field"
            ),
        ),
        ("/joint_states:position[", "'position[' is no field; write it as"),
        (
            "/joint_states:positions[0]",
            (
                "message 1 of topic /joint_states: the message has no field positions; did "
                "you mean position?"
            ),
        ),
        (
            "/joint_states:position[2]",
            "position[2] is out of range: position has 2 entries, the first is position[0]",
        ),
        (
            "/joint_states:velocity[elbow]",
            "velocity[elbow] is out of range: velocity has 0 entries",
        ),
        (
            "/joint_states:position[elbo]",
            "column /joint_states:position[elbo]: no message names it; did you mean elbow?",
        ),
        (
            "/joint_states:position",
            "position is an array of 2; write position[0] for its first entry",
        ),
        ("/joint_states:name[0]", "name[0] is text, no number"),
        ("/joint_states:header", "header has the fields stamp, frame_id; name one of them"),
        ("/wrench:wrench.force[0]", "force is no array; leave [0] out"),
        ("/wrench:wrench.force.z.N", "z has no field N; it has no fields at all"),
        ("/empty:data", "topic /empty holds no messages"),
    ],
)
def test_a_column_that_is_not_there_is_one_line(bag, column, said):
    assert said in refusal(bag({**topics(), "/empty": (bags.NUMBER, [])}), column)


def test_a_topic_without_headers_needs_the_time_of_the_log(bag):
    path = bag({**topics(), "/effort": (bags.NUMBER, [(t, bags.number(t)) for t in T_S])})
    said = refusal(path, "/joint_states:position[0]", "/effort:data")
    assert "message 1 of topic /effort: the message has no field header; there are data" in said
    found = read(path, "/joint_states:position[0]", "/effort:data", time="log time")
    assert found.values["/effort:data"] == pytest.approx(T_S)


@pytest.mark.parametrize("time", ["log time", "header.stamp"])
def test_the_unit_of_stamps_and_of_the_log_is_s(bag, time):
    assert 'is read in s; write unit = "s"' in refusal(bag(topics()), time=time, unit="ns")


def test_time_that_runs_backwards_is_one_line(bag):
    wrong = states()
    wrong[7] = (T_S[7], bags.joint_state(0.02, JOINTS, (0.0, 0.0)))
    said = refusal(bag(topics(joint_states=wrong)))
    assert (
        "column /joint_states:position[elbow], sample 8: time does not run forwards: it "
        "is 0.04 s before the sample above"
    ) in said
    assert '[time] column = "log time"' in said


def test_a_number_that_is_not_finite_is_one_line(bag):
    said = refusal(
        bag(topics(wrenches=[*forces(T_S[:3]), (0.03, bags.wrench(0.03, float("nan")))]))
    )
    assert (
        "message 4 of topic /wrench: wrench.force.z is nan; every message needs a finite number"
        in said
    )


def test_columns_that_never_overlap_are_one_line(bag):
    said = refusal(bag(topics(wrenches=forces(T_S + 0.48))))
    assert (
        "2 samples of /joint_states:position[elbow] lie where all columns were recorded "
        "without a gap above 0.05 s"
    ) in said


def test_a_topic_that_is_slower_than_the_bins_is_one_line(bag):
    said = refusal(bag(topics(wrenches=forces(np.arange(0.0, 0.5, 0.1)))))
    assert (
        f"column {FORCE}: samples come 0.1 s apart, more than windows.bin_s = 0.05 s; "
        "lengthen bin_s"
    ) in said


def test_an_empty_bag_is_one_line(bag):
    assert "holds no messages" in refusal(bag({}))


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_one_line(bag, kept):
    path = bag(topics())
    if path.is_file():
        (file,) = [path]
    else:
        (file,) = [file for file in path.iterdir() if file.suffix != ".yaml"]
    whole = file.read_bytes()
    file.write_bytes(whole[: round(kept * len(whole))])
    said = refusal(path)
    assert "cannot be read as a bag: " in said
    assert ("`mcap recover`" if path.suffix == ".mcap" else "`ros2 bag reindex`") in said


def test_messages_of_another_encoding_are_refused_by_its_name(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap", {"/state": [(t, {"q": t}) for t in T_S]}, encoding="protobuf"
    )
    assert (
        "topic /state: its messages are encoded as protobuf; json, cdr and ros1 can be read"
        in refusal(path, "/state:q", time="log time")
    )


def test_json_that_is_damaged_or_no_number_is_one_line(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap", {"/state": [(t, {"q": None, "on": True}) for t in T_S]}
    )
    assert "q is None, no number" in refusal(path, "/state:q", time="log time")
    assert "on is True, no number" in refusal(path, "/state:on", time="log time")


def test_a_folder_that_is_no_bag_is_one_line(tmp_path):
    (tmp_path / "run").mkdir()
    assert (
        "is a folder without the metadata.yaml of a ROS 2 bag; `ros2 bag reindex` writes it"
        in refusal(tmp_path / "run")
    )


def test_without_its_packages_a_bag_is_refused_with_the_command_that_installs_them(
    tmp_path, monkeypatch
):
    path = bags.write_mcap(tmp_path / "run.mcap", {"/state": [(0.0, {"q": 1.0})]})
    there = recorded_files.find_spec
    monkeypatch.setattr(
        recorded_files, "find_spec", lambda name: None if name == "rosbags" else there(name)
    )
    said = "bags are read by packages that are not installed: pip install 'rfca-rig[bags]'"
    assert said in refusal(path)
    with pytest.raises(BadInput, match=r"rfca-rig\[bags\]"):
        list_columns(path)


def test_a_list_of_columns_names_topics_and_their_numbers(bag):
    content = {**topics(), "/note": (bags.TEXT, [(t, bags.text("on")) for t in T_S])}
    found = list_columns(bag(content))
    assert found.notes == (
        "topic /joint_states: sensor_msgs/msg/JointState, 50 messages",
        "topic /note: std_msgs/msg/String, 50 messages",
        "topic /wrench: geometry_msgs/msg/WrenchStamped, 50 messages",
    )
    forces_and_torques = [
        f"/wrench:wrench.{vector}.{axis}" for vector in ("force", "torque") for axis in "xyz"
    ]
    assert list(found.values) == [
        "/joint_states:position[shoulder]",
        "/joint_states:position[elbow]",
        *forces_and_torques,
    ]
    assert found.values["/joint_states:position[elbow]"] == pytest.approx(2.0 * T_S)
    assert (found.times, found.time_unit) == (("header.stamp",), "s")


def test_a_list_leaves_long_arrays_out(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap", {"/scan": [(t, {"ranges": [t] * 65, "angle": [t] * 2}) for t in T_S]}
    )
    assert list(list_columns(path).values) == ["/scan:angle[0]", "/scan:angle[1]"]


def test_a_list_names_no_time_where_a_topic_has_no_header(bag):
    found = list_columns(
        bag({**topics(), "/effort": (bags.NUMBER, [(t, bags.number(t)) for t in T_S])})
    )
    assert found.times == ()
    assert found.no_time == "log time; or header.stamp, where every topic that is used has one"


def test_a_list_of_a_bag_that_nothing_can_be_read_of_says_why(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap", {"/state": [(0.0, {"q": 1.0})]}, encoding="protobuf"
    )
    found = list_columns(path)
    assert found.notes == (
        "topic /state: state, its messages are encoded as protobuf; json, cdr and ros1 can be read",
    )
    assert not found.values
    assert not found.times


def test_a_folder_of_a_bag_is_one_recording_and_files_beside_it_are_others(tmp_path):
    bags.write_rosbag(tmp_path / "runs" / "first", topics())
    bags.write_mcap(tmp_path / "runs" / "second.mcap", {"/state": [(0.0, {"q": 1.0})]})
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "metadata.yaml").write_text("author: me\n", encoding="utf-8")
    (tmp_path / "notes" / "a.csv").write_text("t\n1\n", encoding="utf-8")
    found = find_recordings(tmp_path)
    assert found == {
        "CSV": [tmp_path / "notes" / "a.csv"],
        "bag": [tmp_path / "runs" / "first", tmp_path / "runs" / "second.mcap"],
    }


@pytest.mark.parametrize("has_summary", [True, False])
def test_a_file_without_an_index_is_read_in_the_order_of_its_log(tmp_path, has_summary):
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(
            file,
            use_chunking=False,
            index_types=IndexType.NONE,
            repeat_channels=False,
            use_statistics=has_summary,
            use_summary_offsets=False,
        )
        writer.start()
        channel = writer.register_channel("/state", "json", 0)
        for k in (1, 0, *range(2, 50)):
            writer.add_message(channel, bags.ns_of(T_S[k]), f'{{"q": {k}}}'.encode(), 0)
        writer.finish()
    found = read(tmp_path / "run.mcap", "/state:q", time="log time")
    assert found.values["/state:q"] == pytest.approx(np.arange(50))


def test_a_topic_with_a_colon_is_not_taken_for_another(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap",
        {"/arm": [(t, {"q": t}) for t in T_S], "/arm:left": [(t, {"q": -t}) for t in T_S]},
    )
    assert read(path, "/arm:left:q", time="log time").values["/arm:left:q"] == pytest.approx(-T_S)


def test_a_definition_that_cannot_be_parsed_is_one_line(tmp_path):
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema(MOTORS, "ros2msg", b"float64[ torque_Nm\n" * 50)
        writer.add_message(writer.register_channel("/motors", "cdr", schema), bags.BEGIN_NS, b"", 0)
        writer.finish()
    said = refusal(tmp_path / "run.mcap", "/motors:torque_Nm")
    assert f"topic /motors: the definition of {MOTORS} cannot be read: " in said
    assert len(said) < 500


def test_a_byte_that_changed_on_the_disk_is_found_by_its_sum(tmp_path):
    path = bags.write_mcap(
        tmp_path / "run.mcap",
        {"/state": [(t, {"q": t}) for t in T_S]},
        compression=CompressionType.NONE,
    )
    path.write_bytes(path.read_bytes().replace(b'{"q": 0.25}', b'{"q": 0.35}'))
    assert "cannot be read as a bag: " in refusal(path, "/state:q", time="log time")


def test_what_this_package_exports_as_json_is_read_back(tmp_path):
    export_mcap(SMALL, tmp_path / "small.mcap", ignore_progress)
    found = read(
        tmp_path / "small.mcap",
        "/static:fz_N",
        "/static:shaft_angle_rad",
        time="log time",
        longest_gap_s=2.0,
    )
    static = read_campaign(SMALL).static
    assert found.t_s == pytest.approx(np.arange(len(static)))
    assert found.values["/static:fz_N"] == pytest.approx([held.fz_N for held in static])
    assert found.values["/static:shaft_angle_rad"] == pytest.approx(
        [held.shaft_angle_rad for held in static]
    )


def test_a_draft_for_bags_lists_topics_and_knows_the_time(tmp_path):
    bags.write_rosbag(tmp_path / "data" / "first", topics())
    bags.write_rosbag(tmp_path / "data" / "second", topics())
    text = drafted(tmp_path / "data")
    assert (
        "# Columns of first, with their smallest and largest values:\n#   topic "
        "/joint_states: sensor_msgs/msg/JointState, 50 messages"
    ) in text
    assert "#   /joint_states:position[elbow]: 0 to 0.98\n" in text
    assert '[time]\ncolumn = "header.stamp"\nunit = "s"\n' in text
    assert 'file = "first"' in text
    assert 'file = "second"' in text
    assert ".db3" not in text
