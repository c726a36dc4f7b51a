"""All that the static stages of some recordings tell of the hinges."""

from dataclasses import dataclass

from rfca_rig.analysis.torque_rotation.checks import FormCheck, Found, HingeCheck, Loop, Stray
from rfca_rig.analysis.torque_rotation.curve import LawValues, TorqueCurve
from rfca_rig.analysis.torque_rotation.points import Points
from rfca_rig.analysis.torque_rotation.recovery import Recovered
from rfca_rig.analysis.torque_rotation.stages import StageData
from rfca_rig.model.parameters import RigModel


@dataclass(frozen=True)
class Repeats:
    """The law's values of each recording by itself, and by how much their scatter widens the errors: 1 where it is as expected."""

    each: tuple[LawValues, ...] = ()
    widened: float = 1.0


@dataclass(frozen=True)
class StaticResult:
    """`law` is the curve k0 (phi + k2 phi^3) with its `values`, `free` the one of splines; `found` is the solution behind `curve`."""

    rig: RigModel
    data: StageData
    found: Recovered
    law: TorqueCurve
    values: LawValues
    free: TorqueCurve
    form: FormCheck
    loop: Loop | None
    hinges: tuple[HingeCheck, ...]
    doubts: tuple[Found, ...]
    strays: tuple[Stray, ...]
    points: Points
    repeats: Repeats

    @property
    def curve(self) -> TorqueCurve:
        """The one to believe."""
        return self.law if self.form.holds else self.free
