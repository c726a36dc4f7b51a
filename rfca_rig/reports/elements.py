"""Elements of a page as HTML: paragraphs, lists, figures with their legends.

Every text is escaped where it enters an element. The functions return Markup, which enters other
elements as it is. So no name from a file can become a part of the page's markup.
"""

from collections.abc import Iterable, Sequence

from markupsafe import Markup

from rfca_rig.escaping import html_text
from rfca_rig.reports.provenance import PageLink
from rfca_rig.reports.style import Panel

EMPTY = Markup("")


def html(pattern: str, *contents: str) -> Markup:
    """The pattern with a content in place of each {}: Markup as it is, any other text escaped."""
    return Markup(pattern).format(*map(escape_text, contents))


def escape_text(text: str) -> Markup:
    """A text as HTML without characters that cannot be printed; Markup as it is."""
    if isinstance(text, Markup):
        return text
    return Markup(html_text(text))


def join(separator: str, contents: Iterable[str]) -> Markup:
    """The contents with a separator between them."""
    return escape_text(separator).join(map(escape_text, contents))


def paragraph(content: str, css: str = "") -> Markup:
    """A paragraph with classes `css` of the style sheet."""
    return html("<p{}>{}</p>", css_class(css), content)


def aside(content: str) -> Markup:
    """A paragraph in small grey letters: how to read what stands beside it."""
    return paragraph(content, "aside")


def subheading(content: str) -> Markup:
    """A heading within a section."""
    return html("<h3>{}</h3>", content)


def code(text: str) -> Markup:
    """A word that files or commands use."""
    return html("<code>{}</code>", text)


def link(file: str, content: str) -> Markup:
    """A link to a file beside the page."""
    return html('<a href="{}">{}</a>', file, content)


def csv_links(*files: str) -> Markup:
    """Where a program reads the numbers of a section."""
    return html("CSV: {}.", join(", ", [link(file, file) for file in files]))


def bullets(contents: Iterable[str], css: str = "") -> Markup:
    """A list with a bullet before each content."""
    items = [html("<li>{}</li>", content) for content in contents]
    return html("<ul{}>\n{}\n</ul>", css_class(css), join("\n", items))


def pairs(listed: Iterable[tuple[str, str]], css: str = "") -> Markup:
    """A list of names with their values."""
    items = [html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in listed]
    return html("<dl{}>\n{}\n</dl>", css_class(css), join("\n", items))


def folded(summary: str, content: str, is_open: bool = False) -> Markup:
    """A content that a reader unfolds by its summary."""
    attribute = " open" if is_open else ""
    return html(
        "<details{}><summary>{}</summary>\n{}\n</details>", Markup(attribute), summary, content
    )


def division(css: str, *contents: str) -> Markup:
    """A division of the page, whose class `css` lays its contents out."""
    return html("<div{}>\n{}\n</div>", css_class(css), join("\n", contents))


def css_class(css: str) -> Markup:
    """The attribute with classes of the style sheet, empty without any."""
    if css:
        return html(' class="{}"', css)
    return EMPTY


def mark(source: str) -> Markup:
    """The mark of a recording: SIM, REAL or IMPORT."""
    return html('<span class="mark {}">{}</span>', source, source)


def list_sources(marked: Iterable[tuple[str, str]]) -> Markup:
    """A list of recordings: the mark of each, and what it holds."""
    return bullets([html("{} {}", mark(source), text) for source, text in marked], "sources")


def page_links(links: Sequence[PageLink]) -> Markup:
    """Links to other pages on the same recordings, or the commands that make them."""
    if not links:
        return EMPTY
    return html('<nav aria-label="Other pages">{}</nav>', join(" · ", map(_page_link, links)))


def _page_link(page: PageLink) -> Markup:
    if page.file:
        return html('{} <span class="file">({})</span>', link(page.file, page.words), page.file)
    return html("{}: {}", page.words, code(page.command))


def verdict(
    stamp_css: str, stamp: str, sentence: str, text: str, number: str = "", number_words: str = ""
) -> Markup:
    """The verdict of a page: its stamp, the sentence and text beside it, and a number in large
    letters with the words below it where there is one.
    """
    stated = html(
        '<div>\n<span class="{}">{}</span>\n<h1>{}</h1>\n{}\n</div>',
        f"stamp {stamp_css}".strip(),
        stamp,
        sentence,
        paragraph(text),
    )
    if not number:
        return division("verdict", stated)
    large = html('<div class="probability"><b>{}</b><span>{}</span></div>', number, number_words)
    return division("verdict", stated, large)


def legend(*entries: Markup) -> Markup:
    """The legend of the figures below it."""
    return paragraph(join("\n", entries), "key")


def legend_line(colour: str, width: float, words: str, dash: str = "") -> Markup:
    """A line in a legend; `colour` as CSS has it, `dash` as SVG has it."""
    dashes = EMPTY
    if dash:
        dashes = html(' stroke-dasharray="{}"', dash)
    pattern = '<path d="M0 6H34" style="stroke: {}" stroke-width="{}"{}/>'
    return _legend_drawing(html(pattern, colour, f"{width:g}", dashes), words)


def legend_dot(edge: str, face: str, radius: float, words: str) -> Markup:
    """A dot in a legend; colours as CSS has them."""
    pattern = '<circle cx="17" cy="6" r="{}" style="fill: {}; stroke: {}"/>'
    return _legend_drawing(html(pattern, f"{radius:g}", face, edge), words)


def legend_diamond(edge: str, face: str, words: str) -> Markup:
    """A diamond in a legend; colours as CSS has them."""
    pattern = '<path d="M17 1L22 6L17 11L12 6Z" fill="{}" stroke="{}"/>'
    return _legend_drawing(html(pattern, face, edge), words)


def _legend_drawing(drawn: Markup, words: str) -> Markup:
    pattern = '<span><svg viewBox="0 0 34 12" aria-hidden="true">{}</svg>{}</span>'
    return html(pattern, drawn, words)


def legend_box(words: str, css: str = "", style: str = "") -> Markup:
    """A box in a legend, filled by a class of the style sheet or by a `style` of its own."""
    own_style = EMPTY
    if style:
        own_style = html(' style="{}"', style)
    return html("<span><i{}{}></i>{}</span>", css_class(css), own_style, words)


def bare_figure(svg: str, css: str = "") -> Markup:
    """A figure without heading and caption; `svg` from `style.inline_svg`."""
    return html("<figure{}>{}</figure>", css_class(css), Markup(svg))


def figure(
    title: str, svg: str, caption: str = "", number: int = 0, of: str = "", css: str = ""
) -> Markup:
    """A figure with its heading.

    Parameters
    ----------
    title
        Heading, and the name for screen readers.
    svg
        The drawing, from `style.inline_svg`.
    caption
        Text below the drawing.
    number
        Number before the heading, 0 for none.
    of
        End of the heading in grey: what distinguishes figures of the same title.
    css
        Classes of the style sheet.
    """
    heading = title
    if number:
        heading = f"{number}. {title}"
    if of:
        heading = html("{} <span>{}</span>", heading, of)
    # On a phone a wide figure scrolls, which a keyboard can do only in what it reaches.
    pattern = '<figure{} tabindex="0" aria-label="{}">\n<h3>{}</h3>\n{}\n{}</figure>'
    return html(pattern, css_class(css), title, heading, Markup(svg), _caption(caption))


def panels(title: str, shown: Sequence[Panel], caption: str = "", css: str = "") -> Markup:
    """A figure of several panels on one scale."""
    drawn = division(f"panels {css}".strip(), *(_panel(panel, title) for panel in shown))
    return html("<figure>\n<h3>{}</h3>\n{}\n{}</figure>", title, drawn, _caption(caption))


def _panel(panel: Panel, title: str) -> Markup:
    if panel.wide:
        region = html(' tabindex="0" role="region" aria-label="{}"', panel.title or title)
    else:
        region = EMPTY
    if panel.title:
        css = css_class("ended" if panel.ended else "")
        heading = html("<h4{}>{}</h4>", css, panel.title)
    else:
        heading = EMPTY
    return html("<div{}>{}{}</div>", region, heading, Markup(panel.svg))


def _caption(text: str) -> Markup:
    if text:
        return html("<figcaption>{}</figcaption>\n", text)
    return EMPTY
