"""Recordings of a mechanism and their reference: windows that can match."""

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.paired import prepare_reference
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.reference.matching import find_matches, name_signals
from tests.mechanism import arm

AT_MOST = 10
SECONDS = 6.0


def write(folder, seeds):
    recordings = [arm.record(arm.Arm(), SECONDS, seed) for seed in seeds]
    arm.write_campaign(folder, arm.Arm(), recordings, {"mass_relative": 0.02})
    path = folder / "experiment.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}[windows]\nat_most = {AT_MOST}\n", encoding="utf-8")
    return read_experiment(folder)


def list_starts(prepared):
    """Start times of the windows by recording."""
    starts = {}
    for part in prepared.conditions:
        times = starts.setdefault(part.recording, [])
        times += [corrected.window.start_s for corrected in part.windows]
    return starts


def test_a_reference_with_more_recordings_has_windows_at_the_same_times(tmp_path):
    """Few of many windows are used; of twice as many recordings, each must keep as many."""
    new_experiment = write(tmp_path / "new", (1, 2))
    new = prepare_mechanism(new_experiment, new_experiment.load_model())
    reference = prepare_reference(new, write(tmp_path / "old", (1, 1, 2, 2)), as_is=False)
    assert new.windows < new.recorded_windows
    starts = [*list_starts(new).values(), *list_starts(reference).values()]
    assert len(starts) == 6
    assert all(times == starts[0] for times in starts)
    rows = reference.dataset.rows
    for part in new.conditions:
        assert len(find_matches(part.rows(), rows, name_signals)) == 2
