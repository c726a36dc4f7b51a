"""report.html of a pendulum."""

from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.pendulums.fit import PENDULUM_FIT
from rfca_rig.diagnosis.pendulums.windows import WINDOW_S
from rfca_rig.report.motions_page import MotionsReport


def pendulum_report(campaign: PendulumCampaign, model_file: str | None) -> MotionsReport:
    """What the page says; `model_file` names the file that the nominal values are from, if not the campaign's own."""
    return MotionsReport(
        kind="swings of a pendulum",
        title=campaign.title,
        nominal=f"the model file {model_file}" if model_file else "pendulum.toml",
        stem="pendulum",
        file_format=PENDULUM_FIT,
        window_s=WINDOW_S,
    )
