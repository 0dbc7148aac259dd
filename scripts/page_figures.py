"""`make figures`: figures of pages become those of the shipped tables; a test compares them.

`shipped_figures.py` says which. A fragment is some words of a page with its figures worked out; it is found by its
words, whatever figures stand on the page, and must be there once. `#` stands for a figure that the shipped rows do not
give. A block is a table between `<!-- made: NAME -->` and `<!-- end -->`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from common import ROOT

NUMBER = r"[-+]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e-?\d+)?%?"
FIGURE = re.compile(rf"(?<![\w.-]){NUMBER}(?!\w)|(?<![\w.])#(?!\w)")


@dataclass(frozen=True)
class Page:
    """What the tables say of a page: fragments, and blocks by name."""

    fragments: list[str] = field(default_factory=list)
    blocks: Mapping[str, str] = field(default_factory=dict)


class FigureError(ValueError):
    """A fragment or a block that is not once on its page."""


def made(text: str, page: Page) -> str:
    """The text with the figures of the tables; raises `FigureError`."""
    for fragment in page.fragments:
        match = _fragment(fragment, text)
        figures = [figure for figure in FIGURE.findall(fragment) if figure != "#"]
        for number, figure in reversed(list(enumerate(figures, 1))):
            text = text[: match.start(number)] + figure + text[match.end(number) :]
    for name, block in page.blocks.items():
        start, end = _block(name, text).span(1)
        text = f"{text[:start]}\n\n{block.strip()}\n\n{text[end:]}"
    return text


def _fragment(fragment: str, text: str) -> re.Match[str]:
    """Where it is, whatever its figures; a group for each that the tables give."""
    words = map(_words, FIGURE.split(fragment))
    holes = [f"(?:{NUMBER})" if figure == "#" else f"({NUMBER})" for figure in FIGURE.findall(fragment)]
    return _once("".join(part for pair in zip(words, [*holes, ""], strict=True) for part in pair), fragment, text)


def _words(text: str) -> str:
    return r"\s+".join(map(re.escape, re.split(r"\s+", text)))


def _block(name: str, text: str) -> re.Match[str]:
    return _once(rf"<!-- made: {re.escape(name)} -->(.*?)<!-- end -->", f"<!-- made: {name} -->", text)


def _once(pattern: str, what: str, text: str) -> re.Match[str]:
    matches = list(re.finditer(pattern, text, re.DOTALL))
    if len(matches) != 1:
        raise FigureError(f"expected once, is there {len(matches)} times: {what}")
    return matches[0]


if __name__ == "__main__":
    from shipped_figures import pages

    for name, page in pages().items():
        path = ROOT / name
        path.write_text(made(path.read_text(encoding="utf-8"), page), encoding="utf-8")
