"""A catalogue of recordings that somebody made to read other files, to never end, to fill the
memory, or to make a reader fail.

`FILES` change a recording in one HDF5 file, `BYTES` the bytes of such a file, `FOLDERS` a run's
folder. A canary beside each is what no reader may show. What `check` takes for a run that a crash
cut off, or for a copy that belongs to no run, is in `NO_DAMAGE`.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import h5py
import numpy as np

from rfca_rig.recording.journal import MAX_BLOCK_BYTES, BlockKind, JournalBlock, frame_block
from tests.recording.first_format import turn_into_first_format
from tests.recording.growing import begun

CANARY = b"canary-7f3a-of-somebody-else"
TABLE = "strokes/001/table"
FZ = f"{TABLE}/fz_N"
TIME = f"{TABLE}/t_s"

FileKind = Callable[[h5py.File, Path], object]
FolderKind = Callable[[Path, Path], object]
FILES: dict[str, FileKind] = {}
BYTES: dict[str, Callable[[Path], object]] = {}
FOLDERS: dict[str, FolderKind] = {}
# Kinds that readers take: unusual, and right.
HARMLESS = {
    "height_of_0.0",
    "height_of_1e-308",
    "times that repeat",
    "times of denormals",
    "fz_N of NaN",
    "shaft_angle_rad of NaN",
}


def of_file(kind: FileKind) -> FileKind:
    FILES[kind.__name__] = kind
    return kind


def of_bytes(kind):
    BYTES[kind.__name__] = kind
    return kind


def of_folder(kind: FolderKind) -> FolderKind:
    FOLDERS[kind.__name__] = kind
    return kind


def harmless(kind):
    HARMLESS.add(kind.__name__)
    return kind


def lay_canary(folder: Path) -> Path:
    """A text, an HDF5 file, a picture and a run of somebody else, all with the canary."""
    folder.mkdir()
    secret = folder / "secret"
    secret.write_bytes(CANARY * 8)
    with h5py.File(folder / "secret.h5", "w") as file:
        file["fz_N"] = np.frombuffer((CANARY * 40)[:844], np.int32)
        file.attrs["title"] = CANARY
    cv2.imwrite(str(folder / "secret.png"), np.zeros((4, 4, 3), np.uint8))
    with (folder / "secret.png").open("ab") as file:
        file.write(CANARY + b"\0\0\0\0IEND\xaeB`\x82")
    (folder / "secret.json").write_text(
        json.dumps({"provenance": {"ended": CANARY.decode()}, "static": None})
    )
    (folder / "secret.jsonl").write_text(
        json.dumps({"event": "run begins", "why": CANARY.decode()}) + "\n"
    )
    return secret


def replaced(file: h5py.File, name: str = FZ, **made) -> h5py.Dataset:
    """A dataset in place of another, with the attributes of that."""
    old = dict(file[name].attrs)
    del file[name]
    new = file.create_dataset(name, **made)
    for key in ("units", "long_name"):
        new.attrs[key] = old[key]
    return new


def values_of(file: h5py.File, name: str = FZ) -> np.ndarray:
    return file[name][:]


# Links, and bytes that are elsewhere.


@of_file
def external_storage(file, secret):
    replaced(file, shape=(211,), dtype=np.float64, external=[(str(secret), 0, 211 * 8)])


@of_file
def external_storage_of_no_file(file, secret):
    replaced(file, shape=(211,), dtype=np.float64, external=[("/dev/zero", 0, 211 * 8)])


@of_file
def external_link(file, secret):
    del file[FZ]
    file[FZ] = h5py.ExternalLink(str(secret.with_suffix(".h5")), "fz_N")


@of_file
def external_link_to_a_group(file, secret):
    file["raw"] = h5py.ExternalLink(str(secret.with_suffix(".h5")), "/")


@of_file
def soft_link(file, secret):
    del file[FZ]
    file[FZ] = h5py.SoftLink(f"/{TABLE}/fy_N")


@of_file
def dangling_soft_link(file, secret):
    del file[FZ]
    file[FZ] = h5py.SoftLink("/nowhere")


@of_file
def soft_links_in_a_circle(file, secret):
    file["raw"] = h5py.SoftLink("/other")
    file["other"] = h5py.SoftLink("/raw")


@of_file
def virtual_dataset(file, secret):
    layout = h5py.VirtualLayout((211,), np.float64)
    layout[:] = h5py.VirtualSource(str(secret.with_suffix(".h5")), "fz_N", (211,))
    del file[FZ]
    file[TABLE].create_virtual_dataset("fz_N", layout)


@of_file
def a_group_in_itself(file, secret):
    file["strokes/004"] = file["strokes"]


@of_file
def one_stroke_under_thousands_of_names(file, secret):
    for number in range(2, 3000):
        file[f"strokes/{number + 10:04d}"] = file["strokes/001"]


@of_file
def one_column_under_two_names(file, secret):
    del file[FZ]
    file[FZ] = file[f"{TABLE}/fy_N"]


@of_file
def object_references(file, secret):
    replaced(file, data=np.array([file[TIME].ref] * 211, dtype=h5py.ref_dtype))


@of_file
def region_references(file, secret):
    replaced(file, data=np.array([file[TIME].regionref[:]] * 211, dtype=h5py.regionref_dtype))


# Sizes that are only claimed, and bytes that grow.


@of_file
def rows_that_are_claimed(file, secret):
    replaced(file, shape=(10**11,), dtype=np.int32, chunks=(1 << 20,), compression="gzip")


@of_file
def rows_that_are_claimed_at_once(file, secret):
    replaced(file, shape=(10**9,), dtype=np.int32)


@of_file
def all_columns_that_are_claimed(file, secret):
    for name in list(file[TABLE]):
        replaced(file, f"{TABLE}/{name}", shape=(10**9,), dtype=np.int32)


@of_file
def huge_chunk(file, secret):
    """One chunk of 1 GB of zeros in 1 MB, of which 211 rows are claimed."""
    packed = _deflated_zeros(1 << 30)
    new = replaced(
        file,
        shape=(211,),
        maxshape=(None,),
        dtype=np.float64,
        chunks=(1 << 27,),
        compression="gzip",
    )
    new.id.write_direct_chunk((0,), packed)


@of_file
def chunk_that_unpacks_to_more_than_it_holds(file, secret):
    new = replaced(file, shape=(211,), dtype=np.float64, chunks=(211,), compression="gzip")
    new.id.write_direct_chunk((0,), _deflated_zeros(1 << 30))


@of_file
def packed_twice(file, secret):
    """10 kB that become 10 MB that become 10 GB."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((211,))
    plist.set_deflate(9)
    plist.set_deflate(9)
    old = dict(file[FZ].attrs)
    del file[FZ]
    made = h5py.h5d.create(
        file[TABLE].id, b"fz_N", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((211,)), plist
    )
    new = h5py.Dataset(made)
    for key in ("units", "long_name"):
        new.attrs[key] = old[key]
    new.id.write_direct_chunk((0,), zlib.compress(_deflated_zeros(1 << 30), 9))


@of_file
def bomb_within_what_deflate_can_pack(file, secret):
    """Every column 400 MB of zeros in 0.4 MB."""
    for name in list(file[TABLE]):
        rows = 50_000_000
        new = replaced(
            file,
            f"{TABLE}/{name}",
            shape=(rows,),
            dtype=np.float64,
            chunks=(rows // 50,),
            compression="gzip",
        )
        packed = zlib.compress(bytes(8 * rows // 50), 9)
        for at in range(50):
            new.id.write_direct_chunk((at * (rows // 50),), packed)


def _deflated_zeros(size: int) -> bytes:
    """So many zeros, a multiple of 1 MiB, as zlib packs them, without packing each of them."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    # After a full flush, a block says nothing of the ones before it, so it can be repeated.
    block = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    adler32 = size % 65521 << 16 | 1
    return b"\x78\xda" + block * (size >> 20) + packer.flush() + adler32.to_bytes(4, "big")


@of_file
def streams_named_ten_thousand_times(file, secret):
    file["strokes/001"].attrs["order"] = json.dumps(["table"] * 4000)


@of_file
def columns_named_ten_thousand_times(file, secret):
    file[TABLE].attrs["order"] = json.dumps(["fz_N"] * 9000)


@of_file
def a_thousand_million_hinges(file, secret):
    file["static"].attrs["hinges"] = 10**9


@of_file
def standard_deviations_without_end(file, secret):
    file["static"].attrs["std"] = json.dumps(["fz_N"] * 10_000)


@of_file
def five_thousand_strokes(file, secret):
    for number in range(2, 5000):
        h5py.h5g.create(file["strokes"].id, str(number).encode())


@of_file
@harmless
def five_thousand_other_members(file, secret):
    group = file.create_group("other")
    for number in range(5000):
        h5py.h5g.create(group.id, str(number).encode())


@of_file
def groups_in_groups(file, secret):
    group = file.create_group("deep").id
    for _ in range(5000):
        group = h5py.h5g.create(group, b"g")


@of_file
@harmless
def a_dataset_that_was_never_written(file, secret):
    file.create_dataset("notes", (1000,), np.float64)


# Attributes.


@of_file
def a_title_of_60_kB_of_escapes(file, secret):
    file.attrs["title"] = "\x1b]0;owned\x07" * 6000


@of_file
def a_title_of_numbers(file, secret):
    file.attrs["title"] = np.arange(7000)


@of_file
def a_title_of_bytes_that_are_no_text(file, secret):
    file.attrs.create("title", np.bytes_(b"\xff\xfe\x80"), dtype=h5py.string_dtype("utf-8", 3))


@of_file
def a_source_of_two(file, secret):
    file.attrs["source"] = ["SIM", "REAL"]


@of_file
def a_format_of_two(file, secret):
    file.attrs["format"] = np.array([1, 2])


@of_file
def an_empty_format(file, secret):
    file.attrs["format"] = h5py.Empty("f8")


@of_file
@harmless
def five_thousand_attributes(file, secret):
    group = file.create_group("other")
    for number in range(5000):
        group.attrs[str(number)] = 1


def height(file, secret, value):
    file["strokes/001"].attrs["height_mm"] = value


for _value in (np.nan, np.inf, -0.215, 0.0, 1e308, 1e-308):
    FILES[f"height_of_{_value}"] = partial(height, value=_value)


def speed(file, secret, value):
    file["strokes/001"].attrs["speed_rad_s"] = value


for _value in (np.nan, np.inf, -1e9, 0.0, 1e308):
    FILES[f"speed_of_{_value}"] = partial(speed, value=_value)


@of_file
def a_height_of_many(file, secret):
    file["strokes/001"].attrs["height_mm"] = np.arange(5.0)


@of_file
def a_height_of_text(file, secret):
    file["strokes/001"].attrs["height_mm"] = "tall"


@of_file
def a_repeat_of_infinity(file, secret):
    file["strokes/001"].attrs["repeat"] = np.inf


@of_file
def a_conversion_of_nan(file, secret):
    turn_into_first_format(file)
    file[FZ].attrs["conversion"] = np.nan


@of_file
def an_offset_of_infinity(file, secret):
    turn_into_first_format(file)
    file[FZ].attrs["offset"] = np.inf


@of_file
def a_conversion_of_text(file, secret):
    turn_into_first_format(file)
    file[FZ].attrs["conversion"] = "one"


@of_file
def a_conversion_of_zero(file, secret):
    turn_into_first_format(file)
    file[FZ].attrs["conversion"] = 0.0


@of_file
def counts_without_conversion(file, secret):
    turn_into_first_format(file)
    del file[FZ].attrs["conversion"]


@of_file
def an_order_that_is_nested(file, secret):
    file["strokes/001"].attrs["order"] = "[" * 30_000 + "]" * 30_000


@of_file
def an_order_of_numbers(file, secret):
    file["strokes/001"].attrs["order"] = "[1, 2]"


@of_file
def an_order_that_names_paths(file, secret):
    file["strokes/001"].attrs["order"] = json.dumps(["../../strokes/001/table"])


# Types and shapes.


def typed_as(file, secret, make):
    replaced(file, data=make())


for _name, _make in {
    "compound": lambda: np.zeros(211, [("a", "<f8"), ("b", "<i4")]),
    "opaque": lambda: np.zeros(211, "V8"),
    "boolean": lambda: np.zeros(211, bool),
    "complex": lambda: np.zeros(211, complex),
    "fixed text": lambda: np.zeros(211, "S8"),
    "two columns": lambda: np.zeros((211, 2)),
    "no dimension": lambda: np.float64(1.0),
    "seven dimensions": lambda: np.zeros((211, 1, 1, 1, 1, 1, 1)),
    "no rows": lambda: np.zeros(0),
    "fewer rows": lambda: np.zeros(210),
    "array elements": lambda: np.zeros(211, np.dtype((np.float64, (3,)))),
}.items():
    FILES[f"column of {_name}"] = partial(typed_as, make=_make)


@of_file
def column_of_lists(file, secret):
    replaced(file, shape=(211,), dtype=h5py.vlen_dtype(np.float64))


@of_file
def column_of_long_text(file, secret):
    replaced(file, shape=(211,), dtype=h5py.string_dtype())[:] = ["x"] * 211


@of_file
@harmless
def column_of_enum(file, secret):
    replaced(file, shape=(211,), dtype=h5py.enum_dtype({"a": 0, "b": 1}, np.int32))


@of_file
@harmless
def column_of_bitfield(file, secret):
    old = dict(file[FZ].attrs)
    del file[FZ]
    made = h5py.h5d.create(
        file[TABLE].id, b"fz_N", h5py.h5t.STD_B64LE, h5py.h5s.create_simple((211,))
    )
    for key, value in old.items():
        if key == "units":
            h5py.Dataset(made).attrs[key] = value


@of_file
def column_without_space(file, secret):
    replaced(file, data=h5py.Empty("f8"))


@of_file
@harmless
def column_of_half_floats(file, secret):
    replaced(file, data=values_of(file).astype(np.float16))


@of_file
@harmless
def column_of_big_endian_numbers(file, secret):
    replaced(file, data=values_of(file).astype(">f8"))


@of_file
def group_in_place_of_a_column(file, secret):
    del file[FZ]
    file.create_group(FZ)


@of_file
def type_in_place_of_a_column(file, secret):
    del file[FZ]
    file[FZ] = np.dtype("f8")


@of_file
def column_in_place_of_the_strokes(file, secret):
    del file["strokes"]
    file["strokes"] = np.zeros(4)


@of_file
def column_in_place_of_a_stream(file, secret):
    del file[TABLE]
    file[TABLE] = np.zeros(4)


@of_file
def no_rows_in_any_column(file, secret):
    for name in list(file[TABLE]):
        replaced(file, f"{TABLE}/{name}", data=np.zeros(0))


@of_file
def one_row_in_every_column(file, secret):
    for name in list(file[TABLE]):
        replaced(file, f"{TABLE}/{name}", data=np.zeros(1))


@of_file
def static_columns_of_different_lengths(file, secret):
    replaced(file, "static/fz_N", data=np.zeros(1))


@of_file
def static_direction_that_is_none(file, secret):
    file["static/direction"][:] = b"sideways"


# Values.


def timed(file, secret, change):
    replaced(file, TIME, data=change(values_of(file, TIME)))


for _name, _change in {
    "times of NaN": lambda t: np.full_like(t, np.nan),
    "one time of NaN": lambda t: np.where(np.arange(len(t)) == 100, np.nan, t),
    "one infinite time": lambda t: np.where(np.arange(len(t)) == 100, np.inf, t),
    "infinite last time": lambda t: np.where(np.arange(len(t)) == len(t) - 1, np.inf, t),
    "times that repeat": lambda t: np.repeat(t[::2], 2)[: len(t)],
    "times that stand still": np.zeros_like,
    "times that run backwards": lambda t: t[::-1].copy(),
    "times in disorder": lambda t: np.random.default_rng(1).permutation(t),
    "times of 1e300": lambda t: t * 1e300,
    "times of denormals": lambda t: t * 1e-310,
}.items():
    FILES[_name] = partial(timed, change=_change)


def valued(file, secret, number, column):
    replaced(file, f"{TABLE}/{column}", data=np.full(211, number))


for _name, _number in {"NaN": np.nan, "infinity": np.inf, "1e308": 1e308}.items():
    for _column in ("fz_N", "shaft_angle_rad"):
        FILES[f"{_column} of {_name}"] = partial(valued, number=_number, column=_column)


@of_file
@harmless
def static_values_of_nan(file, secret):
    replaced(file, "static/fz_N", data=np.full(2, np.nan))


# Filters.


def _with_filter(file: h5py.File, code: int, values: tuple[int, ...]) -> None:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((211,))
    plist.set_filter(code, h5py.h5z.FLAG_OPTIONAL, values)
    old = dict(file[FZ].attrs)
    held = values_of(file)
    del file[FZ]
    made = h5py.h5d.create(
        file[TABLE].id, b"fz_N", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((211,)), plist
    )
    h5py.Dataset(made).attrs["units"] = old["units"]
    made.write_direct_chunk((0,), held.tobytes())


@of_file
def filter_that_does_not_exist(file, secret):
    _with_filter(file, 40_000, (1, 2, 3))


@of_file
def filter_of_a_plugin(file, secret):
    _with_filter(file, 32_001, (2, 2, 8, 1688, 5, 1, 1))


@of_file
def filter_of_scale_and_offset(file, secret):
    replaced(file, data=values_of(file), scaleoffset=3)


@of_file
@harmless
def filters_of_shuffle_and_checksum(file, secret):
    replaced(file, data=values_of(file), shuffle=True, fletcher32=True, compression="gzip")


@of_file
@harmless
def filter_of_lzf(file, secret):
    replaced(file, data=values_of(file), compression="lzf")


# Names and texts.


@of_file
@harmless
def names_of_control_characters(file, secret):
    file.create_group("\x1b[2J\x07\n\t")


@of_file
@harmless
def a_name_of_60_kB(file, secret):
    file.create_group("n" * 60_000)


@of_file
@harmless
def a_name_that_is_no_utf8(file, secret):
    h5py.h5g.create(file.id, b"\xff\xfe\x80")


@of_file
@harmless
def a_stream_of_control_characters(file, secret):
    name = "\x1b[2J\x07\n../../x"
    file["strokes/001"].attrs["order"] = json.dumps([name])
    file.move(TABLE, "strokes/001/" + name.replace("/", "%2F"))


@of_file
@harmless
def a_stream_of_300_letters(file, secret):
    file["strokes/001"].attrs["order"] = json.dumps(["n" * 300])
    file.move(TABLE, "strokes/001/" + "n" * 300)


@of_file
def a_stroke_that_has_no_number(file, secret):
    file.create_group("strokes/²")


@of_file
@harmless
def a_label_of_a_path(file, secret):
    file["strokes/001"].attrs["order"] = json.dumps(["../../../secret"])
    file.move(TABLE, "strokes/001/..%2F..%2F..%2Fsecret")


def _text(file: h5py.File, name: str, text: bytes) -> None:
    del file[name]
    file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8", len(text)))


@of_file
def provenance_nested_deeply(file, secret):
    _text(file, "provenance", b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}")


@of_file
def provenance_of_numbers(file, secret):
    _text(
        file,
        "provenance",
        (
            b'{"plan": 7, "events": 3, "experiment": [1], "operator": {}, "ended": null, '
            b'"seed": 1e400}'
        ),
    )


@of_file
def provenance_that_is_no_text(file, secret):
    _text(file, "provenance", b"\xff\xfe\x80")


@of_file
def a_number_of_100_000_digits(file, secret):
    _text(file, "believed", b'{"leg": ' + b"7" * 100_000 + b"}")


@of_file
def nominal_values_of_nan(file, secret):
    _text(
        file,
        "believed",
        file["believed"][()].replace(b"0.", b"NaN, 0.", 1)
        if b"[0." in file["believed"][()]
        else b'{"leg": {"k0": NaN}}',
    )


@of_file
def a_leg_of_a_million_links(file, secret):
    known = json.loads(file["believed"][()])
    known["leg"]["link_lengths_mm"] = [1.0] * 1_000_000
    _text(file, "believed", json.dumps(known).encode())


@of_file
@harmless
def keys_that_are_there_twice(file, secret):
    _text(file, "known_to", b'{"height_mm": 0.1, "height_mm": 0.2}')


@of_file
@harmless
def events_that_are_none(file, secret):
    _text(file, "provenance", json.dumps({"events": "[" * 5000 + "\n7\nnull\n"}).encode())


@of_file
def a_photo_outside(file, secret):
    for name in ("photo", "overlay"):
        del file[f"static/{name}"]
        file[f"static/{name}"] = np.array(
            [str(secret.with_suffix(".png")).encode(), b"../secret/secret.png"]
        )


# The bytes of the file.


@of_bytes
def cut_short(path):
    os.truncate(path, path.stat().st_size // 2)


@of_bytes
def empty(path):
    os.truncate(path, 0)


@of_bytes
def only_a_signature(path):
    path.write_bytes(b"\x89HDF\r\n\x1a\n")


@of_bytes
def superblock_of_no_version(path):
    content = bytearray(path.read_bytes())
    content[8] = 77
    path.write_bytes(content)


@of_bytes
def superblock_that_ends_nowhere(path):
    content = bytearray(path.read_bytes())
    content[40:48] = b"\xfe" * 8
    path.write_bytes(content)


@of_bytes
def text_in_place_of_hdf5(path):
    path.write_text("t_s,fz_N\n0,1\n")


@of_bytes
def hdf5_within_hdf5(path):
    content = np.frombuffer(path.read_bytes(), np.uint8)
    with h5py.File(path, "w") as file:
        file["inner"] = content


@of_bytes
def a_file_of_1_TB_of_nothing(path):
    os.truncate(path, 1 << 40)


@of_bytes
def user_block_before_it(path):
    """HDF5 reads it as before; the checksum at its end is that of other bytes."""
    content = path.read_bytes()
    path.write_bytes(bytes(512) + content)


# A run's folder.


def _edit_json(path: Path, change) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def written(folder, secret, file, content):
    (folder / file).write_bytes(content)


def of_200_MB(folder, secret, file):
    with (folder / file).open("ab") as opened:
        opened.truncate(200 << 20)
        opened.seek(0, 2)
        opened.write(b"\n")


for _file in ("run.json", "end.json", "events.jsonl", "SHA256SUMS"):
    for _name, _content in {
        "nested deeply": b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}\n",
        "of a huge number": b'{"format": "rfca-run/1", "title": ' + b"7" * 100_000 + b"}\n",
        "of bad UTF-8": b'{"title": "\xff\xfe"}\n',
        "of NaN": (
            b'{"format": "rfca-run/1", "title": NaN, "provenance": NaN, "static": NaN, '
            b'"event": NaN}\n'
        ),
        "of a list": b"[1, 2]\n",
        "of pairs": b'[["format", "rfca-run/1"], ["title", 7], ["provenance", 7], ["static", [7]]]\n',
        "of null bytes": bytes(10_000) + b"\n",
        "of two keys alike": b'{"format": "rfca-run/1", "format": "rfca-run/1"}\n',
    }.items():
        FOLDERS[f"{_file} {_name}"] = partial(written, file=_file, content=_content)

    FOLDERS[f"{_file} of 200 MB"] = partial(of_200_MB, file=_file)


def linked(folder, secret, file, goal):
    suffix = Path(file).suffix
    if goal != "elsewhere":
        target = goal
    elif suffix in ("", ".journal"):
        target = secret
    else:
        target = secret.with_suffix(suffix)
    (folder / file).unlink(missing_ok=True)
    (folder / file).symlink_to(target)


def directory(folder, secret, file):
    (folder / file).unlink(missing_ok=True)
    (folder / file).mkdir()


def pipe(folder, secret, file):
    (folder / file).unlink(missing_ok=True)
    os.mkfifo(folder / file)


for _file in (
    "run.json",
    "end.json",
    "events.jsonl",
    "SHA256SUMS",
    "run.h5",
    "stages/0001.h5",
    "stages/0009.journal",
    "photos/001.png",
):
    for _goal in ("elsewhere", "/dev/zero", Path(_file).name, "/nowhere/at/all"):
        FOLDERS[f"{_file} a link to {_goal}"] = partial(linked, file=_file, goal=_goal)
    FOLDERS[f"{_file} a folder"] = partial(directory, file=_file)

    FOLDERS[f"{_file} a pipe"] = partial(pipe, file=_file)


def folder_linked(folder, secret, name):
    (folder / name).rename(secret.parent / name)
    (folder / name).symlink_to(secret.parent / name)


for _folder in ("stages", "photos"):
    FOLDERS[f"{_folder} a link elsewhere"] = partial(folder_linked, name=_folder)


def summed(folder, secret, name):
    if name == "a pipe":
        os.mkfifo(folder / name)
    with (folder / "SHA256SUMS").open("a") as file:
        file.write(f"{'0' * 64}  {name}\n")


for _name in (
    "../secret/secret",
    "/etc/hostname",
    "/dev/zero",
    "..",
    "a pipe",
    "photos/../../secret/secret",
    "\x1b[2J",
):
    FOLDERS[f"SHA256SUMS names {_name!r}"] = partial(summed, name=_name)


def event(folder, secret, said):
    with (folder / "events.jsonl").open("a") as file:
        file.write(json.dumps(said) + "\n")


for _name, _event in {
    "a file outside": {
        "event": "stage recorded",
        "file": "../secret/secret.h5",
        "sha256": "0",
        "samples": {},
    },
    "an absolute file": {
        "event": "stage recorded",
        "file": "/dev/zero",
        "sha256": "0",
        "samples": {},
    },
    "a list of files": {
        "event": "stage recorded",
        "file": ["stages/0001.h5"],
        "sha256": "0",
        "samples": {},
    },
    "a file alone": {"event": "stage recorded", "file": "stages/0001.h5"},
    "counts that are none": {
        "event": "stage recorded",
        "file": "stages/0001.h5",
        "sha256": 7,
        "samples": "many",
    },
    "nothing": {},
}.items():
    FOLDERS[f"an event names {_name}"] = partial(event, said=_event)


@of_folder
def end_of_another_run(folder, secret):
    (folder / "end.json").write_text(json.dumps({"provenance": {"ended": "never"}, "static": None}))


@of_folder
def end_with_photos_outside(folder, secret):
    def change(content):
        for stage in content["static"] or []:
            stage["photo"] = stage["overlay"] = str(secret.with_suffix(".png"))

    _edit_json(folder / "end.json", change)
    (folder / "run.h5").unlink()


@of_folder
def end_with_stages_of_nonsense(folder, secret):
    _edit_json(
        folder / "end.json",
        lambda content: content.update(static=[{"height_m": "tall", "photo": 7}], provenance=[1]),
    )


@of_folder
def header_without_types(folder, secret):
    _edit_json(
        folder / "run.json",
        lambda content: content.update(title=7, provenance=[1], believed=3, source=["SIM"]),
    )


@of_folder
def header_of_a_source_that_is_none(folder, secret):
    _edit_json(folder / "run.json", lambda content: content.update(source="\x1b[2J"))
    (folder / "run.h5").unlink()


def _journal(folder: Path, content: bytes) -> None:
    (folder / "stages" / "0009.journal").write_bytes(content)


@of_folder
def journal_that_claims_16_MB(folder, secret):
    _journal(folder, struct.pack("<2sBxII", b"RB", 1, MAX_BLOCK_BYTES, 0))


@of_folder
def journal_that_claims_4_GB(folder, secret):
    _journal(folder, struct.pack("<2sBxII", b"RB", 3, 2**32 - 1, 0))


@of_folder
def journal_of_1_GB_of_nothing(folder, secret):
    _journal(folder, b"")
    os.truncate(folder / "stages" / "0009.journal", 1 << 30)


def _framed(kind: BlockKind, said: object) -> bytes:
    return frame_block(
        JournalBlock(kind, said if isinstance(said, bytes) else json.dumps(said).encode())
    )


def journal_begins(folder, secret, said):
    _journal(
        folder,
        _framed(BlockKind.BEGIN, said) + _framed(BlockKind.SAMPLES, struct.pack("<I", 2**32 - 1)),
    )


for _name, _said in {
    "nested deeply": b"[" * 100_000,
    "of no columns": {},
    "of objects": {
        "label": "x",
        "height_m": 0.2,
        "forms": [{"name": "s", "columns": [{"name": "a", "dtype": "O", "unit": ""}]}],
    },
    "of 2 GB a row": {
        "label": "x",
        "height_m": 0.2,
        "forms": [{"name": "s", "columns": [{"name": "a", "dtype": "V2000000000", "unit": ""}]}],
    },
    "of a height of text": {"label": 7, "height_m": "x", "forms": []},
    "of a list": [1],
}.items():
    FOLDERS[f"journal {_name}"] = partial(journal_begins, said=_said)


@of_folder
def journal_of_rows_that_are_claimed(folder, secret):
    _journal(
        folder,
        b"".join(frame_block(block) for block in list(begun(9))[1:4])
        + _framed(BlockKind.SAMPLES, struct.pack("<I", 2**32 - 1)),
    )


@of_folder
def journal_with_an_end_of_nonsense(folder, secret):
    blocks = b"".join(frame_block(block) for block in list(begun(9))[1:6])
    _journal(
        folder,
        blocks
        + _framed(
            BlockKind.END,
            {"stroke": {"speed_rad_s": "x", "repeat": []}, "static": None, "cut_short": 7},
        ),
    )


@of_folder
def journal_with_a_photo_outside(folder, secret):
    blocks = b"".join(frame_block(block) for block in list(begun(9))[1:6])
    static = dict.fromkeys(("height_m", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm"), 0.2) | {
        "stage": 1,
        "direction": "loading",
    }
    static |= {
        "hinge_deg": [0.0] * 6,
        "photo": str(secret.with_suffix(".png")),
        "overlay": "../secret/secret.png",
    }
    _journal(
        folder, blocks + _framed(BlockKind.END, {"stroke": None, "static": static, "cut_short": ""})
    )
    for name in ("end.json", "run.h5", "SHA256SUMS"):
        (folder / name).unlink()


def stage_named(folder, secret, name):
    (folder / "stages" / name).write_bytes((folder / "stages" / "0001.h5").read_bytes())


for _name in ("x.h5", "-1.h5", "1e9.h5", "x.journal", "0001 copy.h5", "².h5"):
    FOLDERS[f"a stage named {_name}"] = partial(stage_named, name=_name)


@of_folder
def photo_that_unpacks_to_gigabytes(folder, secret):
    """A PNG of 30 000 x 30 000 pixels in 2.6 MB."""
    side = 30_000

    def chunk(kind: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content))
            + kind
            + content
            + struct.pack(">I", zlib.crc32(kind + content))
        )

    packer = zlib.compressobj(9)
    rows = b"".join([*(packer.compress(bytes(3 * side + 1)) for _ in range(side)), packer.flush()])
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    content = (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )
    (folder / "photos" / "001.png").write_bytes(content)


@of_folder
def photo_that_is_none(folder, secret):
    (folder / "photos" / "001.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + bytes(1000) + b"\0\0\0\0IEND\xaeB`\x82"
    )


@of_folder
def photo_of_600_MB_of_nothing(folder, secret):
    os.truncate(folder / "photos" / "001.png", 600 << 20)


NO_DAMAGE = {name for name in FOLDERS if name.startswith(("journal", "a stage named"))}
