"""Writes small bags: ROS 2 bags of both storages, and MCAP files of JSON messages."""

import json

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.LATEST)
NS = 1_000_000_000
BEGIN_NS = 1_700_000_000 * NS  # as the clock of a robot says it

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
NUMBER = "std_msgs/msg/Float64"
TEXT = "std_msgs/msg/String"


def ns_of(t_s):
    """The time of a robot's clock that is `t_s` after the beginning of a recording."""
    return BEGIN_NS + round(t_s * NS)


def header(t_s):
    ns = ns_of(t_s)
    stamp = STORE.types["builtin_interfaces/msg/Time"](ns // NS, ns % NS)
    return STORE.types["std_msgs/msg/Header"](stamp, "base")


def joint_state(t_s, names, position, velocity=(), effort=()):
    arrays = (np.array(values, dtype=float) for values in (position, velocity, effort))
    return STORE.types[JOINT_STATE](header(t_s), list(names), *arrays)


def wrench(t_s, force_z_N):
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    return STORE.types[WRENCH](
        header(t_s),
        STORE.types["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, force_z_N), vector(0.0, 0.0, 0.0)),
    )


def number(value):
    return STORE.types[NUMBER](value)


def text(value):
    return STORE.types[TEXT](value)


def write_rosbag(folder, topics, storage=StoragePlugin.SQLITE3, store=STORE, **definition):
    """A folder as `ros2 bag record` writes it, of {topic: (type, [(t_s, message)])};
    `definition` replaces that of the store.
    """
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        logged = []
        for topic, (type_name, messages) in topics.items():
            connection = writer.add_connection(topic, type_name, typestore=store, **definition)
            logged += [
                (ns_of(t_s), connection, store.serialize_cdr(message, type_name))
                for t_s, message in messages
            ]
        for ns, connection, data in sorted(logged, key=lambda one: one[0]):
            writer.write(connection, ns, data)
    return folder


def write_mcap(path, topics, encoding="json", compression=CompressionType.ZSTD):
    """An MCAP file of {topic: [(t_s, fields)]}."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start()
        for topic, messages in topics.items():
            schema = writer.register_schema(topic.strip("/"), "jsonschema", b'{"type": "object"}')
            channel = writer.register_channel(topic, encoding, schema)
            for t_s, fields in messages:
                writer.add_message(channel, ns_of(t_s), json.dumps(fields).encode(), ns_of(t_s))
        writer.finish()
    return path
