"""Effects that a diagnosis looks for: those of the catalogue that the rig may lack, without those that the user excludes."""

from collections.abc import Collection, Iterable

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effect import Effect
from rfca_rig.suggestions import suggestion

EXCLUDED = "not looked for, as asked"


def select_candidates(effects: Iterable[Effect], without: Collection[str]) -> list[Effect]:
    """The effects without those of these ids. Raises BadInput for an id that is in no catalogue."""
    check_known(without)
    return [effect for effect in effects if effect.id not in without]


def check_known(ids: Collection[str]) -> None:
    """Raises BadInput for an id that is in no catalogue."""
    unknown = sorted(set(ids) - set(catalogue()))
    if unknown:
        raise BadInput(f"effect {unknown[0]!r} is not in the catalogue; {suggestion(unknown[0], sorted(catalogue()))}")


def describe_exclusions(without: Collection[str]) -> tuple[str, ...]:
    """The excluded ids as a remark beside the answer; none where nothing was excluded."""
    return (f"{EXCLUDED}: {', '.join(without)}",) if without else ()
