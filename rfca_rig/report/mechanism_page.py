"""report.html of recordings of a mechanism."""

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.mechanisms.comparison import MechanismComparison
from rfca_rig.diagnosis.mechanisms.fit import MECHANISM_FIT
from rfca_rig.report.motions_page import MotionsReport
from rfca_rig.report.residual_pictures import draw_joint_remainders


def mechanism_report(experiment: Experiment, comparison: MechanismComparison) -> MotionsReport:
    """What the page says."""
    return MotionsReport(
        kind="motions of a mechanism",
        title=experiment.title,
        nominal=f"the model file {experiment.model.name}",
        stem="mechanism",
        file_format=MECHANISM_FIT,
        window_s=experiment.window_s,
        remainders=draw_joint_remainders(comparison.joints),
    )
