"""The page in a browser, for those tests that have one."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.view.shown import Shown


@pytest.fixture(scope="module")
def one_page() -> "Iterator[Shown]":
    """One browser, one page, one server for all tests of a module."""
    pytest.importorskip(
        "playwright", reason='the page is tested in a browser: pip install "rfca-rig[dev]"'
    )
    from tests.view.shown import one_page_shown

    with one_page_shown() as shown:
        yield shown


@pytest.fixture
def show(one_page: "Shown") -> "Iterator[Callable[..., Shown]]":
    """Brings the page to a hello and a state; nothing it does may be complained of, unless the
    test takes the complaint away.
    """
    one_page.watched.complaints.clear()
    yield one_page.brought
    assert one_page.watched.complaints == []
