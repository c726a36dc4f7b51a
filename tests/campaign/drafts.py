"""Drafts of experiment.toml for recordings of a cart."""

from typer.testing import CliRunner

from rfca_rig.cli.main import app

MODEL = """<mujoco><worldbody><body><joint name="cart" type="slide" axis="1 0 0"/><geom size="0.1"/></body></worldbody>
<actuator><motor name="push" joint="cart"/></actuator></mujoco>"""


def drafted(folder):
    """The draft of experiment.toml for `folder`."""
    (folder / "experiment.toml").unlink(missing_ok=True)
    (folder.parent / "cart.xml").write_text(MODEL, encoding="utf-8")
    ran = CliRunner().invoke(
        app, ["init", "--mjcf", str(folder.parent / "cart.xml"), "--data", str(folder)]
    )
    assert ran.exit_code == 0, ran.output
    return (folder / "experiment.toml").read_text(encoding="utf-8")
