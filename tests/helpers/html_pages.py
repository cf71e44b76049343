"""Pages as trees, for tests that ask what stands where."""

from __future__ import annotations

from html.parser import HTMLParser
from xml.etree.ElementTree import Element, SubElement

VOID = {"meta", "br", "img"}  # have no end


class _Builder(HTMLParser):
    """Adds what it is fed to a tree; every tag that is opened has to be closed, in order."""

    def __init__(self):
        super().__init__()
        self.stack = [Element("page")]

    def handle_starttag(self, tag, attrs):
        names = [name for name, _ in attrs]
        assert len(set(names)) == len(names), (tag, names)
        element = SubElement(self.stack[-1], tag, {name: value or "" for name, value in attrs})
        if tag not in VOID:
            self.stack.append(element)

    def handle_startendtag(self, tag, attrs):
        SubElement(self.stack[-1], tag, {name: value or "" for name, value in attrs})

    def handle_endtag(self, tag):
        assert tag == self.stack[-1].tag, (tag, [element.tag for element in self.stack])
        self.stack.pop()

    def handle_data(self, data):
        parent = self.stack[-1]
        if len(parent):
            parent[-1].tail = (parent[-1].tail or "") + data
        else:
            parent.text = (parent.text or "") + data


def parsed(html: str) -> Element:
    """The tree of a page or of a part of one; fails unless all tags are closed, in order."""
    builder = _Builder()
    builder.feed(html)
    builder.close()
    (page,) = builder.stack
    return page


def words(element: Element) -> str:
    """The text of an element, with single spaces."""
    return " ".join("".join(element.itertext()).split())


def rows(element: Element) -> list[list[str]]:
    """What the cells of all tables hold, row by row, headings too."""
    return [[words(cell) for cell in row if cell.tag in ("td", "th")] for row in element.iter("tr")]


def section(page: Element, heading: str) -> Element | None:
    """What stands between the heading (h2) and the next one; None where there is no such heading."""
    found = None
    main = page.find(".//main")
    for element in main if main is not None else ():
        if element.tag == "h2":
            if found is not None:
                break
            found = Element("section") if words(element) == heading else None
        elif found is not None:
            found.append(element)
    return found
