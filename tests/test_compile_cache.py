"""A damaged entry of the compile cache is compiled again; it neither stops a program nor runs
other code.
"""

import os
import pickle
import random
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from rfca_rig import compile_cache
from rfca_rig.cli import main
from rfca_rig.compile_cache import CodeCache
from rfca_rig.model.kernel.compiled import CACHE_FOLDER, is_warm

SIGNATURE = (numba.float64,)
EXECUTED: list[str] = []


def add_one(x):
    return x + 1.0


def add_two(x):
    return x + 2.0


def compile_cached(function, folder: Path):
    dispatcher = numba.njit(function)
    dispatcher._cache = CodeCache(function, folder)
    dispatcher.compile(SIGNATURE)
    return dispatcher


@pytest.fixture(scope="module")
def intact(tmp_path_factory) -> Path:
    """A folder with the entries of both functions, never changed."""
    folder = tmp_path_factory.mktemp("intact")
    for function in (add_one, add_two):
        compile_cached(function, folder)
    return folder


@pytest.fixture(autouse=True)
def _first_report():
    compile_cache._was_reported.clear()


def entry_in(folder: Path, function=add_one) -> Path:
    (entry,) = folder.glob(f"*{function.__name__}-*.nbc")
    return entry


class Executing:
    def __reduce__(self):
        return EXECUTED.append, ("code of a pickle",)


def cut(share: float) -> Callable[[Path], None]:
    return lambda entry: os.truncate(entry, int(share * entry.stat().st_size))


def flip_bit(share: float) -> Callable[[Path], None]:
    def damage(entry: Path) -> None:
        content = bytearray(entry.read_bytes())
        content[int(share * (len(content) - 1))] ^= 1
        entry.write_bytes(content)

    return damage


def blank(share: float) -> Callable[[Path], None]:
    """A block of zeros, as a disk leaves it after a loss of power."""

    def damage(entry: Path) -> None:
        content = bytearray(entry.read_bytes())
        begin = int(share * len(content)) // 512 * 512
        content[begin : begin + 512] = bytes(len(content[begin : begin + 512]))
        entry.write_bytes(content)

    return damage


def write(content: bytes) -> Callable[[Path], None]:
    return lambda entry: entry.write_bytes(content)


def replace(make: Callable[[Path], object]) -> Callable[[Path], None]:
    def damage(entry: Path) -> None:
        entry.unlink()
        make(entry)

    return damage


def make_full_folder(entry: Path) -> None:
    (entry / "within").mkdir(parents=True)
    (entry / "within" / "file").write_text("text")


def bind_socket(entry: Path) -> None:
    # The path of a socket may have 107 bytes.
    with socket.socket(socket.AF_UNIX) as listener:
        before = Path.cwd()
        os.chdir(entry.parent)
        try:
            listener.bind(entry.name)
        finally:
            os.chdir(before)


def write_as_of_another_version(entry: Path) -> None:
    content = entry.read_bytes()[compile_cache.SEAL_BYTES :]
    entry.write_bytes(compile_cache._seal(b"another version", content) + content)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "emptied": cut(0.0),
    **{f"cut at {percent} %": cut(percent / 100) for percent in range(3, 100, 3)},
    **{f"a bit flipped at {percent} %": flip_bit(percent / 100) for percent in range(0, 101, 4)},
    **{f"zeros at {percent} %": blank(percent / 100) for percent in range(0, 100, 5)},
    **{
        f"{size} random bytes": write(random.Random(size).randbytes(size))
        for size in (1, 2, 31, 32, 33, 100, 512, 4096, 65536, 1_000_000)
    },
    "bytes added": lambda entry: entry.write_bytes(entry.read_bytes() + b"\0"),
    "twice its content": lambda entry: entry.write_bytes(2 * entry.read_bytes()),
    "text": write(b"not compiled code\n"),
    "zeros alone": write(bytes(5000)),
    "a pickle that runs code": write(pickle.dumps(Executing())),
    "a pickle that ends at once": write(b"\x80\x05."),
    "a pickle behind a wrong seal": lambda entry: entry.write_bytes(
        bytes(32) + entry.read_bytes()[32:]
    ),
    "the code of another function": lambda entry: shutil.copyfile(
        entry_in(entry.parent, add_two), entry
    ),
    "the code of another version": write_as_of_another_version,
    "too large": lambda entry: os.truncate(entry, 300 * 2**30),
    "a folder": replace(Path.mkdir),
    "a folder with files": replace(make_full_folder),
    "a pipe": replace(os.mkfifo),
    "a socket": replace(bind_socket),
    "a link to nothing": replace(lambda entry: entry.symlink_to("nothing")),
    "a link to itself": replace(lambda entry: entry.symlink_to(entry.name)),
    "a link to a device": replace(lambda entry: entry.symlink_to("/dev/zero")),
    "a link to a folder": replace(lambda entry: entry.symlink_to("/")),
    "missing": Path.unlink,
}


def test_a_hundred_kinds_of_damage_are_tried():
    assert len(DAMAGES) >= 100


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_counts_as_none_and_is_replaced(intact, tmp_path, damage, caplog):
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    dispatcher = numba.njit(add_one)
    dispatcher.compile(SIGNATURE)
    (compiled,) = dispatcher.overloads.values()
    cached = CodeCache(add_one, folder)
    assert cached.load_overload(SIGNATURE, dispatcher.targetctx).entry_point is not None
    damage(entry_in(folder))
    assert cached.load_overload(SIGNATURE, dispatcher.targetctx) is None
    cached.save_overload(SIGNATURE, compiled)
    assert cached.load_overload(SIGNATURE, dispatcher.targetctx) is not None
    assert len(caplog.messages) <= 1
    assert not EXECUTED
    assert not list(folder.glob("*.tmp"))


def test_a_function_with_a_damaged_entry_gives_its_own_result(intact, tmp_path):
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    shutil.copyfile(entry_in(folder, add_two), entry_in(folder))
    assert compile_cached(add_one, folder)(1.0) == 2.0
    again = compile_cached(add_one, folder)
    assert again(1.0) == 2.0
    assert sum(again._cache_hits.values()) == 1


@pytest.mark.parametrize("share", [0.0, 0.5], ids=["emptied", "cut in half"])
def test_many_damaged_entries_give_one_line(intact, tmp_path, share, caplog):
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    for function in (add_one, add_two):
        cut(share)(entry_in(folder, function))
    assert compile_cached(add_one, folder)(1.0) == 2.0
    assert compile_cached(add_two, folder)(1.0) == 3.0
    assert len(caplog.messages) == 1
    assert "damaged and is compiled again" in caplog.messages[0]


def make_file(folder: Path) -> None:
    folder.write_text("a file")


def link_to_itself(folder: Path) -> None:
    folder.symlink_to(folder.name)


@pytest.mark.parametrize(
    "make", [make_file, link_to_itself, os.mkfifo], ids=["file", "link to itself", "pipe"]
)
def test_a_folder_that_cannot_be_one_costs_a_compilation_and_a_line(tmp_path, make, caplog):
    folder = tmp_path / "cache"
    make(folder)
    assert compile_cached(add_one, folder)(1.0) == 2.0
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("refused", ["stat", "read_bytes", "mkdir", "write_bytes"])
def test_a_cache_without_permission_costs_a_compilation_and_a_line(
    intact, tmp_path, refused, monkeypatch, caplog
):
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    if refused == "write_bytes":
        entry_in(folder).unlink()

    unrefused = getattr(Path, refused)

    def refuse(path, *arguments, **options):
        if folder == path or folder in path.parents:
            raise PermissionError(13, "Permission denied", str(path))
        return unrefused(path, *arguments, **options)

    if refused == "mkdir":
        shutil.rmtree(folder)
    monkeypatch.setattr(Path, refused, refuse)
    assert compile_cached(add_one, folder)(1.0) == 2.0
    assert len(caplog.messages) == 1
    assert "Permission denied" in caplog.messages[0]


EVALUATE = """
from rfca_rig.model.effects.hinge_stiffness import hinge_stop_torque
from rfca_rig.model.kernel.laws import HINGE, address_of

assert address_of(hinge_stop_torque, HINGE)
"""


@pytest.mark.slow
def test_a_program_goes_on_over_a_damaged_cache(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", EVALUATE]
    subprocess.run(command, env=environment, check=True)
    (entry,) = tmp_path.rglob("*.nbc")
    for damage in (cut(0.0), cut(0.5), write(b"text"), replace(Path.mkdir), replace(os.mkfifo)):
        damage(entry)
        done = subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True, timeout=300
        )
        assert done.stdout == ""
        assert done.stderr.count("\n") == 1
        assert "compiled again" in done.stderr
    assert (
        subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stderr
        == ""
    )


@pytest.mark.slow
@pytest.mark.skipif(
    not is_warm(),
    reason="a copy of a folder with the compiled model is damaged, and none is compiled yet",
)
@pytest.mark.parametrize(
    "damage", [cut(0.0), cut(0.5), replace(Path.mkdir)], ids=["emptied", "cut in half", "folder"]
)
def test_a_command_goes_on_over_a_damaged_cache(tmp_path, damage):
    copied = tmp_path / Path(CACHE_FOLDER).name
    shutil.copytree(CACHE_FOLDER, copied, ignore=shutil.ignore_patterns("laws", "*.tmp"))
    command = [sys.executable, "-m", "rfca_rig", "predict", "--height", "215", "--speed", "2.433"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    expected = subprocess.run(
        command, env=environment, check=True, capture_output=True, text=True
    ).stdout
    (entry,) = copied.glob("model.kernel.forces.measure-*.nbc")
    damage(entry)
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert done.stdout == expected
    assert done.stderr.splitlines() == [f"compiled code was damaged and is compiled again: {entry}"]
    assert (
        subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stderr
        == ""
    )


def test_a_file_that_ends_too_early_is_not_taken_for_an_operator(monkeypatch, capsys):
    def read_file() -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr(main, "_command", lambda: lambda **_: raise_as_typer(read_file))
    with pytest.raises(SystemExit) as ended:
        main.run()
    assert ended.value.code == 1
    assert "EOFError: Ran out of input" in capsys.readouterr().err


def raise_as_typer(call: Callable[[], None]) -> None:
    try:
        call()
    except EOFError as error:
        raise main.Abort from error
