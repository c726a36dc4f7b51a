"""The frame of the package: no circles, one class for a name, shapes where arrays pass."""

import pytest

from tests.structure.tree import (
    Module,
    find_array_functions,
    find_circles,
    find_public_classes,
    read_modules,
)


@pytest.fixture(scope="module")
def modules() -> dict[str, Module]:
    return read_modules()


def test_no_modules_import_each_other(modules):
    assert find_circles(modules) == []


def test_a_public_class_name_is_unique(modules):
    names = find_public_classes(modules)
    assert [name for name, count in names.items() if count > 1] == []


def test_public_functions_of_arrays_state_shapes(modules):
    """But for a few that take an array of any shape."""
    stated = [states for _, states in find_array_functions(modules)]
    assert sum(stated) >= 0.99 * len(stated)
