"""Reads a page as a browser would: its text, the files that it holds, and whatever it would fetch from elsewhere."""

import base64
from html.parser import HTMLParser

_REFERENCES = ("href", "src", "srcset", "action", "data", "poster", "xlink:href")
_EMPTY = ("meta", "br", "img", "link", "input", "hr")


class Page(HTMLParser):
    """A page taken apart.

    Attributes:
        text: all of it, but for its style.
        files: those that it offers, by name.
        tags: all that were opened.
        outside: references to anything that is not in the page.
    """

    def __init__(self, html):
        super().__init__()
        self.text, self.files, self.tags, self.outside, self._open = "", {}, [], [], []
        self.feed(html)
        self.close()
        assert self._open == []
        assert "url(http" not in html
        assert "@import" not in html

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag not in _EMPTY:
            self._open.append(tag)
        given = dict(attributes)
        self.outside += [given[name] for name in _REFERENCES if not given.get(name, "#").startswith(("#", "data:"))]
        if "download" in given:
            self.files[given["download"]] = base64.b64decode(given["href"].partition(",")[2]).decode()

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in _EMPTY:
            self._open.pop()

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if "style" not in self._open:
            self.text += data
