"""The id of an effect stands in its declaration, and nowhere else in the package."""

import ast

from rfca_rig.cli.names import FIT_PARAMETERS
from rfca_rig.model.declarations import LEG, MECHANISM
from rfca_rig.model.families import FAMILIES
from tests.structure.tree import read_modules

# The exam's second implementation shares nothing with what it examines.
WITH_IDS_OF_THEIR_OWN = "rfca_rig.exam"


def test_the_id_of_an_effect_stands_in_its_declaration_alone():
    # Some families and nominal values have the name of an effect.
    other_names = {*FIT_PARAMETERS, *(family.id for family in FAMILIES)}
    ids = {declaration.id for declaration in (*LEG, *MECHANISM)} - other_names
    homes = {}
    for module in read_modules().values():
        if module.name.startswith(WITH_IDS_OF_THEIR_OWN):
            continue
        for node in module.nodes:
            if isinstance(node, ast.Constant) and node.value in ids:
                homes.setdefault(node.value, []).append(module.name)
    derived = {effect_id for effect_id in ids if effect_id.endswith("_of_one")}
    assert set(homes) == ids - derived
    assert [
        (effect_id, modules)
        for effect_id, modules in homes.items()
        if len(modules) > 1 or not modules[0].startswith("rfca_rig.model.declarations.")
    ] == []
