"""What a page consists of, as a browser would read it."""

from html.parser import HTMLParser

# Tables beside a page are links that a reader may follow; a page is whole without them.
FILES = (".csv", ".tex", ".json", ".h5")
VOID = {"meta", "br", "img"}


class Outline(HTMLParser):
    """Checks that elements close as they opened, and collects ids, text and what could be
    fetched; no element is one of `forbidden`.
    """

    def __init__(self, page, forbidden=("script", "link", "iframe", "img", "object")):
        super().__init__()
        self.open = []
        self.ids = []
        self.fetched = []
        self.text = ""
        self.forbidden = forbidden
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self._note(tag, attrs)

    def handle_startendtag(self, tag, attrs):
        self._note(tag, attrs)

    def _note(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]
        found = [
            value
            for name, value in attrs
            if name in ("src", "href", "xlink:href", "data", "srcset")
        ]
        self.fetched += [value for value in found if tag != "a" or not value.endswith(FILES)]
        assert tag not in self.forbidden

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
