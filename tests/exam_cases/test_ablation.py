"""Effects that are taken out of the catalogue: which cases are asked again, and what counts as
what.
"""

import json
from functools import partial
from pathlib import Path

import pytest

from rfca_rig.errors import RigError
from rfca_rig.exam import cases
from rfca_rig.exam.answer import DETECTABLE
from rfca_rig.exam.examine import examine
from rfca_rig.exam.follow_up import ABLATION_FOLDER, read_ablation, run_ablation
from rfca_rig.exam.sealing import open_all
from rfca_rig.executors.mapping import InProcessExecutor


def saying(verdict: str, *effects: tuple[str, float]):
    """Always the same answer; keeps what it was asked to do without."""
    asked: list[tuple[str, str]] = []

    def diagnose(without: str, campaign: Path, into: Path) -> None:
        asked.append((campaign.name, without))
        into.mkdir(parents=True, exist_ok=True)
        listed = [
            {"id": name, "probability": probability, "parameters": {}}
            for name, probability in effects
        ]
        (into / "diagnosis.json").write_text(
            json.dumps({"format": "rfca-diagnosis/1", "verdict": verdict, "effects": listed})
        )

    return diagnose, asked


@pytest.fixture(scope="module")
def exam(tmp_path_factory):
    """Four cases of one effect each, and what is in those of them that show it."""
    folder = tmp_path_factory.mktemp("taken") / "exam"
    examine(folder, 3, {cases.SINGLE: 4}, partial(saying("nothing missing")[0], ""))
    visible = {
        t["case"]: next(iter(t["effects"]))
        for t in open_all(folder)
        if t["size"]["left_over_noise"] >= DETECTABLE
    }
    assert 2 <= len(visible) < 4
    return folder, visible


def fresh(exam):
    folder, visible = exam
    for path in sorted((folder / ABLATION_FOLDER).rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    return folder, visible


@pytest.mark.long
def test_those_that_show_are_asked_again_each_without_its_own_effect(exam):
    folder, visible = fresh(exam)
    diagnose, asked = saying("unexplained")
    run_ablation(folder, diagnose, InProcessExecutor())
    assert dict(asked) == visible
    found = read_ablation(folder)
    assert found is not None
    assert (found.confident_wrong.hits, found.unexplained.hits, found.silent.hits) == (
        0,
        len(visible),
        0,
    )
    assert found.confident_wrong.of == len(visible) and found.named == ()
    again, asked = saying("unexplained")
    run_ablation(folder, again, InProcessExecutor())
    assert asked == []


@pytest.mark.slow
@pytest.mark.parametrize(("probability", "wrong"), [(0.97, 1.0), (0.6, 0.0)])
def test_any_sure_name_is_wrong(exam, probability, wrong):
    folder, visible = fresh(exam)
    run_ablation(folder, saying("named", ("gravity_tilt", probability))[0], InProcessExecutor())
    found = read_ablation(folder)
    assert found is not None
    assert found.confident_wrong.value == wrong
    assert {each.case: each.effect for each in found.named} == visible
    assert all(
        each.named == ("gravity_tilt",) and each.probability == probability for each in found.named
    )


@pytest.mark.slow
def test_nothing_missing_is_counted_by_itself(exam):
    folder, visible = fresh(exam)
    run_ablation(folder, saying("nothing missing")[0], InProcessExecutor())
    found = read_ablation(folder)
    assert found is not None
    assert found.silent.hits == len(visible) and found.unexplained.hits == 0
    assert f"{len(visible)} as nothing missing" in found.words


@pytest.mark.slow
def test_one_that_cannot_be_diagnosed_is_told_and_tried_again(exam):
    folder, visible = fresh(exam)

    def crashing(without: str, campaign: Path, into: Path) -> None:
        raise ZeroDivisionError(f"{campaign} {into} {without}")

    with pytest.raises(
        RigError, match=r"entries taken out: all but .* as case-000. not with ZeroDivisionError"
    ):
        run_ablation(folder, crashing, InProcessExecutor())
    diagnose, asked = saying("unexplained")
    run_ablation(folder, diagnose, InProcessExecutor())
    assert dict(asked) == visible
