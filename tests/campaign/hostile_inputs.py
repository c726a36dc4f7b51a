"""Models, TOML files, tables, CAN logs and bags that nobody means well with: too large, too deep,
without an end, or with absurd values.
"""

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

Write = Callable[[Path], None]
BODY = '<body name="b"><joint name="j" axis="0 1 0"/><geom name="g" size=".1" mass="1"/></body>'


def text(content: str) -> Write:
    return lambda path: path.write_text(content, encoding="utf-8") and None


def model(*, world: str = BODY, rest: str = "") -> Write:
    return text(f"<mujoco>{rest}<worldbody>{world}</worldbody></mujoco>")


def joint(attributes: str) -> Write:
    return model(world=f'<body><joint name="j" {attributes}/><geom size=".1" mass="1"/></body>')


def geom(attributes: str) -> Write:
    return model(world=f'<body><joint name="j"/><geom {attributes}/></body>')


def including(name: str, make: Callable[[Path], object]) -> Write:
    """A model that includes a file beside it, which `make` makes."""

    def write(path: Path) -> None:
        make(path.with_name(name))
        model(rest=f'<include file="{name}"/>')(path)

    return write


def with_mesh(make: Callable[[Path], object]) -> Write:
    """A model with a mesh, whose file `make` makes."""

    def write(path: Path) -> None:
        make(path.with_name("mesh.stl"))
        rest = '<asset><mesh name="m" file="mesh.stl"/></asset>'
        model(rest=rest, world='<body><joint name="j"/><geom type="mesh" mesh="m"/></body>')(path)

    return write


def sparse(size: int) -> Write:
    def write(path: Path) -> None:
        path.touch()
        os.truncate(path, size)

    return write


def include_itself(path: Path) -> None:
    model(rest=f'<include file="{path.name}"/>')(path)


def nest(depth: int) -> str:
    return (
        f'<body><geom size=".1" mass="1"/>{"<body>" * depth}<geom '
        f'size=".1"/>{"</body>" * depth}</body>'
    )


def replicate(count: str, within: str = '<geom size=".01"/>') -> Write:
    return model(world=f'{BODY}<replicate count="{count}">{within}</replicate>')


def stl(triangles: int, written: int, coordinate: float = 0.1) -> Write:
    points = struct.pack(
        "<12fH",
        *([0.0] * 3),
        *([0.0, 0.0, 0.0, coordinate, 0.0, 0.0, 0.0, coordinate, coordinate]),
        0,
    )
    return lambda path: (
        path.write_bytes(bytes(80) + struct.pack("<I", triangles) + points * written) and None
    )


LAUGHS = "<!ENTITY e0 'aaaaaaaaaa'>" + "".join(
    f"<!ENTITY e{k} '" + f"&e{k - 1};" * 10 + "'>" for k in range(1, 10)
)

MODELS: dict[str, Write] = {
    **{
        f"gravity {value}": model(rest=f'<option gravity="0 0 {value}"/>')
        for value in ("nan", "inf", "-inf", "1e300", "1e20")
    },
    **{
        f"timestep {value}": model(rest=f'<option timestep="{value}"/>')
        for value in ("nan", "inf", "0", "-1", "1e300", "1e-300", "1e9")
    },
    **{
        f"option {name} nan": model(rest=f'<option {name}="nan"/>')
        for name in ("density", "viscosity", "impratio")
    },
    **{
        f"mass {value}": geom(f'size=".1" mass="{value}"')
        for value in ("nan", "inf", "1e300", "-1", "1e18")
    },
    **{f"density {value}": geom(f'size=".1" density="{value}"') for value in ("nan", "1e300")},
    **{
        f"size {value}": geom(f'size="{value}" mass="1"') for value in ("nan", "inf", "1e300", "-1")
    },
    **{
        f"joint {name} {value}": joint(f'{name}="{value}"')
        for name in ("damping", "stiffness", "armature", "frictionloss")
        for value in ("nan", "inf", "1e300")
    },
    "joint range nan": joint('limited="true" range="nan nan"'),
    "joint ref nan": joint('ref="nan"'),
    "joint axis nan": joint('axis="nan 0 0"'),
    "body pos nan": model(world='<body pos="nan 0 0"><joint name="j"/><geom size=".1"/></body>'),
    "body pos 1e300": model(
        world='<body pos="1e300 0 0"><joint name="j"/><geom size=".1"/></body>'
    ),
    "inertia nan": model(
        world='<body><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="nan 1 1"/></body>'
    ),
    "inertia 1e300": model(
        world=(
            '<body><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="1e300 1e300 '
            '1e300"/></body>'
        )
    ),
    "friction nan": geom('size=".1" friction="nan 0 0"'),
    "gear nan": model(rest='<actuator><motor joint="j" gear="nan"/></actuator>'),
    "gain 1e300": model(rest='<actuator><general joint="j" gainprm="1e300"/></actuator>'),
    "hfield 60000": model(
        rest='<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>'
    ),
    "hfield 2e9": model(
        rest='<asset><hfield name="h" nrow="2000000000" ncol="2000000000" size="1 1 1 1"/></asset>'
    ),
    "texture 40000": model(
        rest=(
            '<asset><texture name="t" type="2d" builtin="flat" width="40000" '
            'height="40000"/></asset>'
        )
    ),
    **{
        f"{name} 1e9": model(rest=f'<size {name}="1000000000"/>')
        for name in ("nuser_body", "nuser_jnt", "nuser_geom", "nuser_sensor")
    },
    **{
        f"memory {value}": model(rest=f'<size memory="{value}"/>')
        for value in ("900G", "9000000000T", "-5")
    },
    **{
        f"{name} 2e9": model(rest=f'<size {name}="2000000000"/>')
        for name in ("nkey", "njmax", "nconmax", "nstack", "nuserdata")
    },
    "300,000 keyframes": model(rest="<keyframe>" + '<key qpos="1"/>' * 300_000 + "</keyframe>"),
    "keyframe nan": model(rest='<keyframe><key qpos="nan"/></keyframe>'),
    **{
        f"replicate {count}": replicate(count)
        for count in ("100000000", "2000000000", "-1", "1000000")
    },
    "replicate within replicate": replicate(
        "10000", '<replicate count="10000"><geom size=".01"/></replicate>'
    ),
    "replicated joints": replicate("3000", '<body><joint name="k"/><geom size=".01"/></body>'),
    "20,000 bodies deep": model(world=f"{BODY}{nest(20_000)}"),
    "100,000 geoms": model(world=BODY + '<geom size=".1"/>' * 100_000),
    "composite 1e9": model(
        world=f'{BODY}<composite type="cable" count="1000000000 1 1"><geom size=".1"/></composite>'
    ),
    "flexcomp 1e4 cubed": model(
        world=(
            f'{BODY}<flexcomp name="f" type="grid" dim="3" count="10000 10000 10000" '
            'spacing="1 1 1"/>'
        )
    ),
    "include a pipe": including("pipe.xml", os.mkfifo),
    "include a device": including("zero.xml", lambda path: path.symlink_to("/dev/zero")),
    "include a folder": including("folder.xml", Path.mkdir),
    "include itself": include_itself,
    "include 20 GB of zeros": including("zeros.xml", sparse(20 * 2**30)),
    "mesh from a pipe": with_mesh(os.mkfifo),
    "mesh from a device": with_mesh(lambda path: path.symlink_to("/dev/zero")),
    "mesh of 20 GB": with_mesh(sparse(20 * 2**30)),
    "mesh of 4e9 triangles": with_mesh(stl(2**32 - 1, 1)),
    "mesh of nan": with_mesh(stl(20, 20, float("nan"))),
    "mesh of random bytes": with_mesh(lambda path: path.write_bytes(bytes(range(256)) * 400)),
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": Path.mkdir,
    "20 GB of zeros": sparse(20 * 2**30),
    "no text": lambda path: path.write_bytes(bytes(range(256))) and None,
    "empty": text(""),
    "billion laughs": text(f"<!DOCTYPE m [{LAUGHS}]><mujoco model='&e9;'/>"),
}

TOMLS: dict[str, Write] = {
    "50,000 dots": text(".".join(["a"] * 50_000) + " = 1\n"),
    "50,000 dots with spaces": text(" . ".join(["a"] * 50_000) + " = 1\n"),
    "50,000 dots of quoted keys": text(".".join(['"a"'] * 50_000) + " = 1\n"),
    "50,000 dots in a header": text("[" + ".".join(["a"] * 50_000) + "]\n"),
    "50,000 dots in a list of tables": text("[[" + ".".join(["a"] * 50_000) + "]]\n"),
    "50,000 dots in an inline table": text("x = { " + ".".join(["a"] * 50_000) + " = 1 }\n"),
    "50,000 dots in a second key": text("x = { b = 1, " + ".".join(["a"] * 50_000) + " = 1 }\n"),
    "100,000 lists deep": text("x = " + "[" * 100_000 + "]" * 100_000),
    "100,000 tables deep": text("x = " + "{a=" * 100_000 + "1" + "}" * 100_000),
    "200,000 unknown keys": text("".join(f"k{number} = 1\n" for number in range(200_000))),
    "200,000 tables": text("".join(f"[t{number}]\n" for number in range(200_000))),
    "200,000 entries": text("[[x]]\n" * 200_000),
    "a number of 1,000,000 digits": text("x = " + "9" * 1_000_000),
    "a float of 1,000,000 digits": text("x = 0." + "9" * 1_000_000),
    "3 MB of one text": text('x = "' + "a" * 3_000_000 + '"'),
    "3 MB of blanks": text(" " * 3_000_000),
    "3 MB of quotes": text('"' * 3_000_000),
    "3 MB of backslashes": text('x = "' + "\\\\" * 1_500_000 + '"'),
    "1,000,000 numbers": text("x = [" + "1," * 1_000_000 + "]"),
    "100 MB": text("#" * 100_000_000),
    "20 GB of zeros": sparse(20 * 2**30),
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
}


def csv(head: str, line: str, count: int) -> Write:
    return text(head + "\n" + (line + "\n") * count)


TABLES: dict[str, Write] = {
    "20 GB of zeros": sparse(20 * 2**30),
    "3 GB of zeros": sparse(3 * 10**9),
    "20 MB of zeros": sparse(20_000_000),
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "10,000,000 lines of nothing": csv("t,q", "", 10_000_000),
    "a fault after 2,000,000 lines": text("t,q\n" + "1,2\n" * 2_000_000 + "1,x\n"),
    "texts in 2,000,000 lines": csv("t,q", "a,b", 2_000_000),
    "1,000,000 columns": csv(
        ",".join(f"c{number}" for number in range(1_000_000)), "1," * 999_999 + "1", 3
    ),
    "1,000,000 cells in a line": csv("t,q", "1," * 1_000_000, 3),
    "one cell of 20 MB": csv("t,q", "1," + "9" * 20_000_000, 1),
    "an open quote": csv("t,q", '1,"' + "a" * 5_000_000, 2),
    "quotes alone": text('t,q\n"' + '"' * 5_000_000),
    "random bytes": lambda path: path.write_bytes(bytes(range(256)) * 40_000) and None,
    "numbers of 1,000,000 digits": csv("t,q", "9" * 1_000_000 + ",1", 12),
    "commas alone": text("," * 10_000_000),
    "header alone of 20 MB": text("a" * 20_000_000),
    "times of nan": csv("t,q", "nan,1", 20),
    "times of 1e308": csv("t,q", "1e308,1e308", 20),
}

MAGIC = b"\x89MCAP0\r\n"


def record(opcode: int, length: int, content: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", length) + content


def mcap(*records: bytes) -> Write:
    header = record(1, 8, struct.pack("<II", 0, 0))
    return lambda path: path.write_bytes(MAGIC + header + b"".join(records) + MAGIC) and None


def zstd_bomb(unpacked: int) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor(level=19).compress(bytes(unpacked))


def chunk(unpacked: int, compression: bytes, content: bytes) -> bytes:
    body = (
        struct.pack("<QQQI", 0, 1, unpacked, 0)
        + struct.pack("<I", len(compression))
        + compression
        + struct.pack("<Q", len(content))
        + content
    )
    return record(6, len(body), body)


def blf(*objects: bytes) -> Write:
    """A log of Vector with these objects, and a database beside it."""
    head = b"LOGG" + struct.pack("<L", 144) + bytes(136)
    database = 'VERSION ""\nBU_: A\nBO_ 41 M: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\n'

    def write(path: Path) -> None:
        path.with_suffix(".dbc").write_text(database, encoding="utf-8")
        path.write_bytes(head + b"".join(objects))

    return write


def blf_object(kind: int, content: bytes, size: int | None = None) -> bytes:
    stated = 16 + len(content) if size is None else size
    return b"LOBJ" + struct.pack("<HHLL", 16, 1, stated, kind) + content


def container(unpacked: bytes) -> bytes:
    return blf_object(10, struct.pack("<HxxxxxxLxxxx", 2, len(unpacked)) + zlib.compress(unpacked))


# A frame of no length, after which the same frame comes again.
_FRAME = struct.pack("<LHHQ", 2, 0, 0, 0) + struct.pack("<HBBL8s", 1, 0, 8, 41, bytes(8))

CAN_LOGS: dict[str, Write] = {
    "head alone": blf(),
    "container that claims 4 GB": blf(blf_object(10, b"", 2**32 - 1)),
    "container of 256 MB of zeros": blf(container(bytes(2**28))),
    "frame without end": blf(container(blf_object(1, _FRAME, 0))),
    "object of no length": blf(blf_object(1, b"", 0)),
    "random bytes": blf(bytes(range(256)) * 4000),
    "line without end": lambda path: (
        blf()(path),
        path.write_bytes(b"(1.0) can0 029#" + b"00" * 50_000_000),
    )[0],
    "database of 200,000 signals": lambda path: (
        blf()(path),
        path.with_suffix(".dbc").write_text(
            'VERSION ""\nBU_: A\nBO_ 41 M: 8 A\n' + ' SG_ S : 0|8@1+ (1,0) [0|0] "" A\n' * 200_000,
            encoding="utf-8",
        ),
    )[0],
    "signal of 10**9 bits": lambda path: (
        blf(container(blf_object(1, _FRAME)))(path),
        path.with_suffix(".dbc").write_text(
            'VERSION ""\nBU_: A\nBO_ 41 M: 8 A\n SG_ S : 0|1000000000@1+ (1,0) [0|0] "" A\n',
            encoding="utf-8",
        ),
    )[0],
}


BAGS: dict[str, Write] = {
    "magic alone": mcap(),
    "record of 2**63 bytes": mcap(record(3, 2**63, b"")),
    "record of 2**40 bytes": mcap(record(5, 2**40, b"")),
    "chunk that claims 2**40 bytes": mcap(chunk(2**40, b"zstd", b"(\xb5/\xfd")),
    "chunk of 8 GB of zeros": mcap(chunk(8 * 2**30, b"zstd", zstd_bomb(2**28) * 32)),
    "chunk of unknown compression": mcap(chunk(100, b"magic", b"abc")),
    "100,000 schemas": mcap(*[record(3, 14, struct.pack("<HIII", 1, 0, 0, 0))] * 100_000),
    "random bytes": lambda path: path.write_bytes(bytes(range(256)) * 4000) and None,
    "20 GB of zeros": sparse(20 * 2**30),
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "empty": lambda path: path.touch(),
}
