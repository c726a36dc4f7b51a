"""MCAP read back with the reader and the Protocol Buffers of other people, value by value."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader

from rfca_rig.errors import BadInput
from rfca_rig.export.mcap_file import Exported, export_mcap
from rfca_rig.export.messages import Layout
from rfca_rig.progress import ignore_progress
from rfca_rig.recording.model import Column, RawStage, Recording, Stream, Stroke
from rfca_rig.recording.store import write_recording
from tests.export.recordings import HOLD_S, STARTS_S, lay_photos, recording, streams

BEGAN_NS = 1_795_309_200 * 10**9  # 2026-11-22T01:00:00Z
SMALL = Path("tests/data/small-campaign")

Messages = list[tuple[int, dict[str, Any]]]


def read_back(path: Path) -> dict[str, Messages]:
    """(log time in ns, fields) by topic, decoded by the schema that the file itself brings."""
    found: dict[str, Messages] = {}
    pools: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(
            log_time_order=False
        ):
            assert message.log_time == message.publish_time
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                pools[schema.id] = pools.get(schema.id) or message_class(schema.name, schema.data)
                decoded = pools[schema.id].FromString(message.data)
                content = {
                    field.name: getattr(decoded, field.name) for field in decoded.DESCRIPTOR.fields
                }
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def message_class(name: str, descriptor: bytes) -> Any:
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptor).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Exported, Path]:
    folder = tmp_path_factory.mktemp("run")
    known = recording()
    write_recording(known, folder / "run.h5")
    lay_photos(folder)
    return (
        known,
        export_mcap(folder, folder / "out" / "small.mcap", ignore_progress),
        folder / "out" / "small.mcap",
    )


@pytest.fixture(scope="module")
def topics(exported) -> dict[str, Messages]:
    return read_back(exported[2])


def all_streams(known: Recording, name: str) -> list[tuple[float, Stream]]:
    """With the host time of their zero, in the order of time."""
    stages = [*zip(STARTS_S, (stroke.streams for stroke in known.strokes), strict=True)]
    stages += zip((HOLD_S, 25.0), (stage.streams for stage in known.raw), strict=True)
    return [(zero_s, streams[name]) for zero_s, streams in stages]


@pytest.mark.parametrize("device", ["shaft", "force"])
def test_every_value_of_every_record_is_there_bit_by_bit(exported, topics, device):
    known = exported[0]
    fields: dict[str, list[float]] = {}
    for _, content in topics[f"/{device}"]:
        for name, value in content.items():
            fields.setdefault(name, []).append(value)
    streams = [stream for _, stream in all_streams(known, device)]
    assert fields.pop("t_s") == np.concatenate([stream.t_s for stream in streams]).tolist()
    assert set(fields) == set(streams[0].columns)
    for name, values in fields.items():
        assert (
            values == np.concatenate([stream.columns[name].values for stream in streams]).tolist()
        ), name


def test_counts_stay_whole_numbers(topics):
    first = topics["/force"][0][1]
    assert (first["status"], first["rdt_sequence"]) == (0x80020000, 2**32 - 5)
    assert isinstance(first["status"], int)


@pytest.mark.parametrize("device", ["shaft", "force"])
def test_times_are_the_devices_own_placed_on_the_hosts_clock(exported, topics, device):
    expected = np.concatenate(
        [zero_s + stream.t_s for zero_s, stream in all_streams(exported[0], device)]
    )
    found = np.array([ns - BEGAN_NS for ns, _ in topics[f"/{device}"]]) * 1e-9
    assert np.abs(found - expected).max() < 2e-9


def test_messages_come_in_the_order_of_time(exported):
    with exported[2].open("rb") as file:
        times = [
            message.log_time
            for _, _, message in make_reader(file).iter_messages(log_time_order=False)
        ]
    assert times == sorted(times)
    assert len(times) == exported[1].messages


def test_stages_say_where_they_begin_and_what_they_are(topics):
    begins = [
        (round((ns - BEGAN_NS) * 1e-9, 6), content["label"]) for ns, content in topics["/stage"]
    ]
    assert begins == [
        (12.4, "flap 215 mm, 2.433 rad/s, repeat 1"),
        (16.65, "flap 215 mm, 2.433 rad/s, repeat 2"),
        (19.9, "hold 1 at 60.0 deg, 215 mm, loading"),
        (24.9, "flap 215 mm, 2.433 rad/s, repeat 3"),
    ]
    assert topics["/stage"][0][1]["height_mm"] == 215.0
    assert topics["/stage"][3][1]["cut_short"] == "TRIP L-01"


def test_events_are_log_lines_at_their_time_and_a_trip_is_an_error(topics):
    lines = [(ns, content["level"], content["message"]) for ns, content in topics["/log"]]
    assert lines[0] == (BEGAN_NS, 2, "SIM recording: small")
    assert lines[2] == (BEGAN_NS + 12_300_000_000, 2, "stage begins: stage flap 215 mm")
    assert lines[3] == (BEGAN_NS + 30_000_250_000, 4, "motor off: why TRIP L-01: force 312 N")
    stamp = topics["/log"][3][1]["timestamp"]
    assert stamp["sec"] * 10**9 + stamp["nsec"] == lines[3][0]


def test_a_photo_is_its_own_bytes_and_a_lost_one_is_told(exported, topics):
    (ns, photo), *more = topics["/photo"]
    assert (more, photo["format"], ns) == ([], "png", topics["/stage"][2][0])
    assert (
        base64.b64decode(photo["data"]) == (exported[2].parents[1] / "photos/001.png").read_bytes()
    )
    assert (exported[1].pictures, exported[1].missing) == (1, ("overlays/001.jpg",))


def test_static_means_have_null_where_no_angle_was_told(topics):
    row = topics["/static"][0][1]
    assert (row["stage"], row["fz_N"], row["hinge2_deg"], row["hinge7_deg"]) == (
        1,
        -2.36,
        -5.5,
        None,
    )


def test_the_file_says_what_it_is(exported):
    with exported[2].open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata["recording"]["source"] == "SIM"
    assert metadata["provenance"] == {"seed": "1"}
    force = next(channel for channel in summary.channels.values() if channel.topic == "/force")
    assert (force.metadata["fz_N"], force.metadata["source"]) == ("N", "SIM")
    assert all(
        channel.schema_id in summary.schemas for channel in summary.channels.values()
    )  # PlotJuggler opens nothing else
    assert {summary.schemas[c.schema_id].name for c in summary.channels.values()} >= {
        "foxglove.Log",
        "foxglove.CompressedImage",
    }
    assert summary.statistics.message_count == exported[1].messages


@pytest.mark.parametrize(
    ("resumed", "later_s"),
    [
        ("2026-11-23T08:00:0", 31 * 3600.0),
        ("2026-11-22T01:00:0", 10.9),
    ],  # the next day; on a twin, whose clock begins anew
)
def test_a_run_that_was_resumed_has_a_clock_for_each_part(tmp_path, resumed, later_s):
    events = (
        {"event": "run begins", "t_s": 0.0, "utc": "2026-11-22T01:00:00+00:00"},
        {
            "event": "stage begins",
            "t_s": 4.9,
            "utc": "2026-11-22T01:00:04.900000+00:00",
            "stage": "flap 200 mm, 1 rad/s, repeat 1",
        },
        {
            "event": "stage begins",
            "t_s": 9.9,
            "utc": "2026-11-22T01:00:09.900000+00:00",
            "stage": "flap 200 mm, 1 rad/s, repeat 2",
        },
        {"event": "run resumed", "t_s": 0.0, "utc": f"{resumed}0+00:00"},
        {
            "event": "stage begins",
            "t_s": 4.9,
            "utc": f"{resumed}4.900000+00:00",
            "stage": "flap 200 mm, 1 rad/s, repeat 2",
        },
    )
    strokes = tuple(Stroke(0.2, 1.0, repeat, streams(5.0, 140, repeat)) for repeat in (1, 2))
    cut_short = RawStage("flap 200 mm, 1 rad/s, repeat 2", 0.2, streams(10.0, 140, 3), "stopped")
    text = "".join(json.dumps(event) + "\n" for event in events)
    write_recording(
        Recording("resumed", "SIM", {}, {}, strokes, (), {"events": text}, (cut_short,)),
        tmp_path / "run.h5",
    )
    export_mcap(tmp_path, tmp_path / "out.mcap", ignore_progress)
    topics = read_back(tmp_path / "out.mcap")
    later_ns = round(later_s * 1e9)
    assert [ns - BEGAN_NS for ns, _ in topics["/stage"]] == [
        4_900_000_000,
        9_900_000_000,
        later_ns + 4_900_000_000,
    ]
    assert [content.get("cut_short") for _, content in topics["/stage"]] == [None, "stopped", None]
    assert topics["/log"][-1][0] == BEGAN_NS + later_ns + 4_900_000_000


def test_a_campaign_from_elsewhere_follows_stage_after_stage(tmp_path):
    export_mcap(SMALL, tmp_path / "small.mcap", ignore_progress)
    topics = read_back(tmp_path / "small.mcap")
    begins = [ns for ns, _ in topics["/stage"]]
    assert begins == sorted(set(begins))
    assert min(np.diff([ns for ns, _ in topics["/table"]])) > 0
    assert len(topics["/static"]) > 1


def test_more_fields_than_one_byte_of_tag_holds():
    layout = Layout("wide", tuple((f"x{i}", i % 3 == 0) for i in range(40)))
    message = layout.empty_messages(1)
    for i in range(40):
        message[f"x{i}"] = i
    decoded = message_class(layout.type_name, layout.descriptor).FromString(message.tobytes())
    assert [getattr(decoded, f"x{i}") for i in range(40)] == list(range(40))


def test_columns_of_a_spreadsheet_may_be_called_anything(tmp_path):
    odd = {"temp (°C)": 21.5, "temp  °C ": 22.5, "2nd": 3.0, "naïve": 5.0}
    stream = Stream(
        np.zeros(3), {name: Column(np.full(3, value), "") for name, value in odd.items()}
    )
    stroke = Stroke(0.2, 1.0, 1, {"my table": stream})
    write_recording(Recording("odd", "IMPORT", {}, {}, (stroke,), ()), tmp_path / "run.h5")
    export_mcap(tmp_path / "run.h5", tmp_path / "odd.mcap", ignore_progress)
    content = read_back(tmp_path / "odd.mcap")["/my table"][0][1]
    assert list(content.values()) == [0.0, *odd.values()]
    assert all(name.isascii() and name.isidentifier() for name in content)


def test_what_is_no_recording_leaves_nothing_behind(tmp_path):
    with pytest.raises(BadInput):
        export_mcap(tmp_path / "none", tmp_path / "out.mcap", ignore_progress)
    (tmp_path / "run.h5").write_bytes(b"no")
    with pytest.raises(BadInput):
        export_mcap(tmp_path, tmp_path / "out.mcap", ignore_progress)
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]
