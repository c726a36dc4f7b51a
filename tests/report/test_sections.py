"""A page is a list of sections: their headings, the list of contents, columns, cards of tables."""

import re

from rfca_rig.reports.elements import bullets, code, html, join, paragraph
from rfca_rig.reports.html_table import NUMBER, HtmlCell, HtmlColumn, HtmlFoot, card_table
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.sections import PageSection, SideBySide, render_sections
from rfca_rig.reports.templates import render_page
from tests.report.outline import Outline

NASTY = "<b>&\"leg'"
SECTIONS = [
    PageSection("First & last", [paragraph("one"), paragraph("two")]),
    None,
    PageSection("Below it", [paragraph("three")], level=3),
    SideBySide("sides", [[PageSection("Left", [paragraph("four")])], [None]]),
    PageSection("", [paragraph("five")]),
    PageSection(NASTY, [paragraph("six")]),
]


def test_sections_stand_in_their_order_below_their_headings():
    shown = str(render_sections(SECTIONS))
    assert re.sub(r"<[^>]*>|\s+", " ", shown).split() == [
        *("First", "&amp;", "last", "one", "two", "Below", "it", "three", "Left", "four", "five"),
        *("&lt;b&gt;&amp;&quot;leg&#x27;", "six"),
    ]
    assert re.findall(r"<(h\d|section|div[^>]*)>", shown) == [
        *("h3", 'div class="sides"', "section", "section")
    ]


def test_the_list_of_contents_leads_to_the_sections_of_level_two():
    page = render_page("title", paragraph("opening"), SECTIONS, Origin())
    outline = Outline(page)
    assert outline.ids == ["first-last", "left", "b-leg"]
    assert outline.fetched == ["#first-last", "#left", "#b-leg"]
    assert page.index("opening") < page.index('class="contents"') < page.index("<main>")
    # Two headings are found without a list.
    assert 'class="contents"' not in render_page("title", paragraph(""), SECTIONS[:4], Origin())


def test_what_an_element_is_given_stays_text_and_what_it_made_stays_markup():
    shown = str(bullets([NASTY, html("{} and {}", code(NASTY), "\x1b"), join(NASTY, ["a", "b"])]))
    assert Outline(shown).text.split("\n") == [
        "",
        NASTY,
        f"{NASTY} and \N{REPLACEMENT CHARACTER}",
        f"a{NASTY}b",
        "",
    ]
    assert "<b>" not in shown and shown.count("<code>") == 1


def test_the_rows_of_a_card_table_have_the_headings_of_their_columns():
    columns = (
        HtmlColumn("Name", card=""),
        HtmlColumn("Value, ± std", NUMBER, card="Value"),
        HtmlColumn("Count", NUMBER),
    )
    rows = [(HtmlCell("a", unit="mm"), "1.0", HtmlCell("·", "n zero"))]
    shown = str(card_table(NASTY, columns, rows, [HtmlFoot("all", 2, (HtmlCell("3", NUMBER),))]))
    assert Outline(shown).open == []
    assert re.findall(r"<td[^>]*>[^<]*", shown) == [
        '<td data-unit="mm">a',
        '<td class="n" data-head="Value">1.0',
        '<td class="n zero" data-head="Count">·',
        '<td class="words" colspan="2">all',
        '<td class="n" data-head="Count">3',
    ]
    assert 'class="stack"' in shown and re.findall(r'<th scope="col"([^>]*)>', shown) == [
        "",
        ' class="n"',
        ' class="n last"',
    ]
