"""Files outside a folder of recordings are not read: links, and files that a model names; unless
the user allows them.
"""

import shutil
from pathlib import Path

import pytest

import rfca_rig as rr
from rfca_rig.campaign.experiment import read_experiment, write_draft
from rfca_rig.campaign.opening import import_pendulum, open_recordings
from rfca_rig.campaign.pendulum import read_pendulum
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from tests.cli.malformed_inputs import CART, EXPERIMENT, MECHANISM
from tests.cli.typed import typed

DATA = Path(__file__).parents[1] / "data"
SECRET = "the secret of another folder"
MODEL = (
    "<mujoco>{head}<worldbody>{body}<body><joint name='cart' type='slide' axis='1 0 "
    "0'/><geom size='0.1'/></body></worldbody></mujoco>"
)
BODY = (
    "<mujocoinclude><body><joint name='more' type='slide'/><geom "
    "size='0.1'/></body></mujocoinclude>"
)
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """A folder with an experiment on a mechanism; beside it are files of somebody else."""
    folder = tmp_path / "cart"
    folder.mkdir()
    for name, text in (("experiment.toml", EXPERIMENT), ("model.xml", MECHANISM), ("a.csv", CART)):
        (folder / name).write_text(text, encoding="utf-8")
    (tmp_path / "other").mkdir()
    for name, text in (
        ("secret.csv", f"{SECRET}\n"),
        ("a.csv", CART),
        ("part.xml", BODY),
        ("model.xml", MECHANISM),
        ("mesh.obj", TETRAHEDRON),
    ):
        (tmp_path / "other" / name).write_text(text, encoding="utf-8")
    return folder


def _link(file: Path, target: Path) -> None:
    file.unlink(missing_ok=True)
    file.symlink_to(target)


def _refusal(action) -> str:
    with pytest.raises(BadInput) as refused:
        action()
    line = str(refused.value)
    assert SECRET not in line
    assert "--allow-outside" in line
    assert "\n" not in line
    return line


@pytest.mark.parametrize("name", ["experiment.toml", "model.xml", "a.csv"])
def test_links_of_an_experiment_are_not_followed(cart: Path, name: str):
    _link(cart / name, cart.parent / "other" / "secret.csv")
    line = _refusal(lambda: read_experiment(cart))
    assert str(cart / name) in line
    assert str(cart.parent / "other" / "secret.csv") in line


def test_links_are_followed_where_they_stay_inside_or_are_allowed(cart: Path):
    (cart / "a.csv").rename(cart / "first.csv")
    _link(cart / "a.csv", Path("first.csv"))
    assert len(read_experiment(cart).runs[0].t_s) == 1200
    _link(cart / "a.csv", cart.parent / "other" / "a.csv")
    assert len(read_experiment(cart, allow_outside=True).runs[0].t_s) == 1200
    assert len(rr.open(cart, allow_outside=True)) == 1
    _refusal(lambda: rr.open(cart))


def test_a_folder_that_is_reached_by_a_link_is_inside_itself(cart: Path, tmp_path: Path):
    (tmp_path / "shortcut").symlink_to(cart)
    assert read_experiment(tmp_path / "shortcut").title == "cart"


def test_a_link_to_itself_is_refused_in_a_line(cart: Path):
    _link(cart / "a.csv", Path("a.csv"))
    with pytest.raises(BadInput):
        read_experiment(cart)


def test_a_model_may_stand_where_experiment_toml_says(cart: Path):
    text = (cart / "experiment.toml").read_text().replace('"model.xml"', '"../other/model.xml"')
    (cart / "experiment.toml").write_text(text)
    experiment = read_experiment(cart)
    assert load_mechanism(experiment.model, experiment.model_folders).joints == ("cart",)


def test_links_of_a_bag_are_not_followed(cart: Path, tmp_path: Path):
    (cart / "bag").mkdir()
    (cart / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (cart / "bag" / "bag_0.db3").symlink_to(tmp_path / "other" / "secret.csv")
    (cart / "experiment.toml").write_text(
        (cart / "experiment.toml").read_text().replace("a.csv", "bag")
    )
    _refusal(lambda: read_experiment(cart))


def test_a_draft_reads_no_links(cart: Path, tmp_path: Path):
    (cart / "experiment.toml").unlink()
    _link(cart / "a.csv", tmp_path / "other" / "secret.csv")
    _refusal(lambda: write_draft(load_mechanism(cart / "model.xml"), cart))
    assert not (cart / "experiment.toml").exists()
    _link(cart / "a.csv", tmp_path / "other" / "a.csv")
    assert write_draft(load_mechanism(cart / "model.xml"), cart, allow_outside=True).is_file()


@pytest.mark.parametrize("name", ["campaign.toml", "runs/dynamic-02.csv", "runs/static.csv"])
def test_links_of_a_campaign_are_not_followed(tmp_path: Path, name: str):
    folder = tmp_path / "campaign"
    shutil.copytree(DATA / "small-campaign", folder)
    shutil.copy(folder / name, tmp_path / "outside")
    _link(folder / name, tmp_path / "outside")
    _refusal(lambda: read_campaign(folder))
    _refusal(lambda: open_recordings([folder]))
    assert open_recordings([folder], allow_outside=True)[0].strokes


def test_links_of_a_pendulum_are_not_followed(tmp_path: Path):
    folder = tmp_path / "swing"
    shutil.copytree(DATA / "pendulums" / "free-swing", folder)
    (tmp_path / "secret").write_text(SECRET)
    # An import copies licences beside the recordings.
    (folder / "LICENSE-of-data").symlink_to(tmp_path / "secret")
    _refusal(lambda: import_pendulum(folder, tmp_path / "imported"))
    assert not (tmp_path / "imported").exists()
    import_pendulum(folder, tmp_path / "imported", allow_outside=True)
    run = next((folder / "runs").iterdir())
    shutil.copy(run, tmp_path / "outside")
    _link(run, tmp_path / "outside")
    _refusal(lambda: read_pendulum(folder))
    assert read_pendulum(folder, allow_outside=True).runs


OUTSIDE_PART = (
    ("../other/part.xml", "'"),
    ("../other/part.xml", '"'),
    ("&#46;&#46;/other/part.xml", "'"),
    ("..\\other\\part.xml", "'"),
    ("{folder}/other/part.xml", "'"),
    ("linked.xml", "'"),
)


@pytest.mark.parametrize(("file", "quote"), OUTSIDE_PART)
@pytest.mark.parametrize("start", ["<include ", "<include\n\tfile1='>' "])
def test_a_model_includes_nothing_from_outside(
    cart: Path, tmp_path: Path, file: str, quote: str, start: str
):
    (cart / "linked.xml").symlink_to(tmp_path / "other" / "part.xml")
    include = f"{start}file = {quote}{file.format(folder=tmp_path)}{quote}/>"
    (cart / "model.xml").write_text(MODEL.format(head="", body=include))
    assert "part.xml" in _refusal(lambda: load_mechanism(cart / "model.xml"))


def test_nor_do_the_parts_that_it_includes(cart: Path):
    (cart / "parts").mkdir()
    (cart / "model.xml").write_text(MODEL.format(head="", body="<include file='parts/one.txt'/>"))
    (cart / "parts" / "one.txt").write_text(
        "<mujocoinclude><include file='../../other/part.xml'/></mujocoinclude>"
    )
    _refusal(lambda: load_mechanism(cart / "model.xml"))


def test_an_allowed_model_includes_what_it_names(cart: Path):
    (cart / "model.xml").write_text(
        MODEL.format(head="", body="<include file='../other/part.xml'/>")
    )
    assert load_mechanism(cart / "model.xml", allow_outside=True).joints == ("more", "cart")
    assert load_mechanism(cart / "model.xml", beside=(cart.parent,)).joints == ("more", "cart")


@pytest.mark.parametrize(
    "head",
    [
        "<asset><mesh name='m' file='../other/mesh.obj'/></asset>",
        "<compiler meshdir='../other'/><asset><mesh name='m' file='mesh.obj'/></asset>",
        "<compiler assetdir='{folder}/other'/><asset><mesh name='m' file='mesh.obj'/></asset>",
        (
            "<compiler strippath='true' meshdir='../other'/><asset><mesh name='m' "
            "file='/nowhere/mesh.obj'/></asset>"
        ),
        "<asset><texture name='t' type='2d' file='../other/secret.csv'/></asset>",
        "<asset><hfield name='h' size='1 1 1 1' file='../other/secret.csv'/></asset>",
        "<asset><model name='part' file='../other/model.xml'/></asset>",
    ],
)
def test_meshes_textures_and_height_fields_stay_inside(cart: Path, tmp_path: Path, head: str):
    (cart / "model.xml").write_text(MODEL.format(head=head.format(folder=tmp_path), body=""))
    _refusal(lambda: load_mechanism(cart / "model.xml"))


def test_meshes_inside_are_read(cart: Path):
    (cart / "meshes").mkdir()
    (cart / "meshes" / "mesh.obj").write_text(TETRAHEDRON)
    head = "<compiler meshdir='meshes'/><asset><mesh name='m' file='mesh.obj'/></asset>"
    (cart / "model.xml").write_text(MODEL.format(head=head, body="<geom type='mesh' mesh='m'/>"))
    assert load_mechanism(cart / "model.xml").model.nmesh == 1


def test_a_model_that_names_too_much_is_refused_at_once(cart: Path):
    meshes = "".join(f"<mesh name='m{k}' file='{k}.obj'/>" for k in range(110_000))
    (cart / "model.xml").write_text(MODEL.format(head=f"<asset>{meshes}</asset>", body=""))
    with pytest.raises(BadInput, match="names 110000 files"):
        load_mechanism(cart / "model.xml")


@pytest.mark.parametrize("words", [("check",), ("report",), ("fit",), ("diagnose",)])
def test_commands_say_what_where_and_the_option(cart: Path, monkeypatch, capsys, words):
    monkeypatch.chdir(cart.parent)
    _link(cart / "a.csv", cart.parent / "other" / "secret.csv")
    before = sorted(cart.parent.iterdir())
    said = typed(monkeypatch, capsys, *words, "cart")
    assert said.exit_code == 2
    assert "cart/a.csv" in said.err
    assert "--allow-outside" in said.err
    assert SECRET not in said.out + said.err
    assert sorted(cart.parent.iterdir()) == before
    _link(cart / "a.csv", cart.parent / "other" / "a.csv")
    if words == ("check",):
        assert typed(monkeypatch, capsys, *words, "cart", "--allow-outside").exit_code == 0
