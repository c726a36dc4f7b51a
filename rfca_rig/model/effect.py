"""Data model of an effect: a piece of physics that a model may lack.

`Declaration` is what an effect is, `Effect` the declaration with a law for one simulator. Those of
the package are declared in `declarations`, and an effect that two simulators have is declared once.
A lab's own effect is one file, which states both at once.
"""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, fields, replace
from math import inf, isfinite
from typing import Any, Literal

Values = Mapping[str, float]

# On which side of the drive's compliance the encoder of the shaft must be to show an effect.
MOTOR_SIDE = "motor side"
LEG_SIDE = "leg side"


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. The name carries the unit; `low` to `high` is the plausible range on
    a rig like this.

    Values outside of the range are allowed, within limits: a value is finite, not below zero where
    `low` is not, not zero unless `may_be_zero`, smaller in magnitude than `below`, and an integer
    where it counts something (`whole`). `starts` are values from which a search begins, where steps
    over the plausible range would miss the effect. `neutral` is the value of a shape parameter, or
    of one of `begins`, that is used where no value is given.
    """

    name: str
    low: float
    high: float
    may_be_zero: bool = True
    below: float = inf
    whole: bool = False
    starts: tuple[float, ...] = ()
    neutral: float = 0.0

    def why_not(self, value: float) -> str | None:
        """Reason, in words, why the value is not allowed; None if it is."""
        if not isfinite(value):
            return "must be a finite number"
        if value < 0.0 <= self.low or (value == 0.0 and not self.may_be_zero):
            if self.may_be_zero:
                return "must be 0 or more"
            return "must be above 0"
        if self.whole and not value.is_integer():
            return "must be a whole number"
        if abs(value) >= self.below:
            return f"must stay below {self.below:g} in magnitude"
        return None


@dataclass(frozen=True)
class EqualLimit:
    """A limit in which the law of an effect becomes that of another one, so that no data
    distinguish the two.

    `other` is the id of that one, `words` the limit. `holds` says whether values of parameters and
    shape are so near to it that the other law, fitted again, differs by less than a fifth of the
    effect. A fifth is the usual error of a law.
    """

    other: str
    words: str
    holds: Callable[[Values], bool]


@dataclass(frozen=True)
class JointTorque:
    """The law of an effect in the joints of a mechanism or a pendulum.

    `torque(u, values)` returns an array (k,) in N m or N that resists a positive `quantity` u (k,)
    of the joint: speeds in rad/s or m/s, or positions in rad or m.
    """

    quantity: Literal["speed", "position"]
    torque: Callable[[Any, Values], Any]


@dataclass(frozen=True)
class Declaration:
    """What an effect is, without the law as code. Everything that lists effects follows from it.

    Parameters
    ----------
    id
        The name in files and answers.
    where
        Where it enters.
    left_out
        In a few words what a model without it lacks.
    law
        As a formula.
    source
        Of the law.
    families
        Ids of the families whose laws act alike. An effect that names none is a family of its own.
    single
        "joint", "actuator" or "sensor" where the law may act in one of them alone, which `of_one`
        declares.
    variant_of
        The most general effect of which this one is a special case, as dry friction is of
        Stribeck's.
    same_as
        The nominal value, as `fit` calls it, whose error acts exactly like the effect: only the
        prior of that value distinguishes the two.
    law_of
        "speed" or "position" where the law is a torque of a joint over that quantity. A law that is
        measured in the joint takes its place.
    encoder
        MOTOR_SIDE where every recorded angle of the shaft shows it: it is then judged by that angle
        and not by the forces. LEG_SIDE where only an encoder on the leg's side does.
    in_motion_only
        A settled reading does not show it.
    bench_test
        The kind of the bench test, of `bench_tests`, that shows it whatever the rig does.
    needs_order
        Its law counts the strokes that the leg has made before. It is tried only where recordings
        state their order.
    needs_k2
        Its law is written in k0 and k2 of the spring, so that it has no meaning in a leg with a
        measured curve.

    Raises
    ------
    ValueError
        Where `encoder` is another word.
    """

    id: str
    where: str
    left_out: str
    law: str
    source: str
    _: KW_ONLY
    families: tuple[str, ...] = ()
    single: str = ""
    variant_of: str = ""
    same_as: str = ""
    law_of: str = ""
    encoder: str = ""
    in_motion_only: bool = False
    bench_test: str = ""
    needs_order: bool = False
    needs_k2: bool = False

    def __post_init__(self) -> None:
        if self.encoder not in ("", MOTOR_SIDE, LEG_SIDE):
            raise ValueError(
                f"effect {self.id}: encoder is {self.encoder!r}; it takes {MOTOR_SIDE!r} or "
                f"{LEG_SIDE!r}"
            )

    def of_one(self) -> "Declaration":
        """The same law in one joint, actuator or sensor alone."""
        return replace(
            self,
            id=f"{self.id}_of_one",
            left_out=f"{self.left_out}, of one {self.single}",
            single="",
            variant_of=self.variant_of or self.id,
            # No bench test is proposed for one actuator or sensor yet.
            bench_test=self.bench_test if self.single == "joint" else "",
        )

    def make_effect(
        self,
        parameters: tuple[Parameter, ...],
        apply: Callable[[Any, Values], Any],
        begins: tuple[Parameter, ...] = (),
        shape: tuple[Parameter, ...] = (),
        equal_limits: tuple[EqualLimit, ...] = (),
    ) -> "Effect":
        """The effect with its law in one simulator; arguments as in `Effect`."""
        declared = {item.name: getattr(self, item.name) for item in fields(Declaration)}
        return Effect(
            **declared,
            parameters=parameters,
            apply=apply,
            begins=begins,
            shape=shape,
            equal_limits=equal_limits,
        )


@dataclass(frozen=True)
class Effect(Declaration):
    """A declaration with its law for one simulator: one entry of a catalogue.

    Parameters
    ----------
    parameters
        Its numbers: sizes, and places that are counted.
    apply
        `apply(setup, values)` returns the setup with the effect in it, in the form of its
        simulator: `setup.Setup` for a leg. `values` holds one number per parameter, one per
        parameter of `shape`, and one for each of `begins`.
    begins
        Initial states where a recording begins, 0 for at rest. They are no property of the rig and
        are never reported.
    shape
        Nuisance parameters of the law, which describe its form and not its size. They are optional
        in a file, where their neutral values apply; a diagnosis fits them together with the effect.
    equal_limits
        Those in which its law becomes that of another effect: a diagnosis then reports both as one
        set.
    family
        The only one of `families`, for a lab's own effect.
    joint_torque
        The law as a torque over the motion of a joint, with which a mechanism may have it, too;
        None where it has no such form.

    Raises
    ------
    ValueError
        Where the neutral value of a shape parameter lies outside of its plausible range.
    """

    parameters: tuple[Parameter, ...]
    apply: Callable[[Any, Values], Any]
    begins: tuple[Parameter, ...] = ()
    shape: tuple[Parameter, ...] = ()
    equal_limits: tuple[EqualLimit, ...] = ()
    family: str = ""
    joint_torque: JointTorque | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for parameter in self.shape:
            if not parameter.low <= parameter.neutral <= parameter.high:
                raise ValueError(
                    f"effect {self.id}: shape parameter {parameter.name} has its neutral "
                    f"value {parameter.neutral:g} outside of "
                    f"{parameter.low:g} to {parameter.high:g}"
                )
