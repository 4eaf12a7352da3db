"""The directive `railroad`, which draws rules of a grammar: `{railroad} query pattern body`, or all of `query`."""

from __future__ import annotations

import posixpath
import re
from html import escape
from typing import TYPE_CHECKING, Any

import railroad
from docutils import nodes
from grammar_files import Choice, Part, Pattern, Reference, Repetition, Sequence, definition_of, read_grammar_file
from grammar_text import literal_text, plain_name, rule_text, shown_definition, shown_rules
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGES = {
    "common": "reference/grammar-expressions",
    "expressions": "reference/grammar-expressions",
    **{name: f"reference/grammar-{name}" for name in ("metamodel", "model", "query", "rules", "environment")},
}
"""By grammar file: the page that draws all of its rules."""

ROOM = 640
"""The width in pixels that diagrams try to keep: that of the text in the theme."""
_LOOP, _BRANCH = 20, 40  # what the arcs around a part take

railroad.CHAR_WIDTH = 7.9  # of the monospaced font at 13 pixels
railroad.INTERNAL_ALIGNMENT = "left"


class Drawing:
    """Draws parts of a grammar, with links from names to the diagrams of the rules."""

    def __init__(self, page_address: Any) -> None:
        self._page_address = page_address

    def svg(self, rule: Reference) -> str:
        """Return the diagram of a rule as an SVG element for HTML."""
        pieces: list[str] = []
        diagram = railroad.Diagram(self._draw(shown_definition(rule), ROOM))
        diagram.format(4)
        # A link inside an element with the role `img` cannot be reached by keyboard, so the role is `group`.
        diagram.attrs |= {"role": "group", "aria-label": f"Diagram of {plain_name(rule.name)}"}
        diagram.writeSvg(pieces.append)
        return re.sub(r"\n\s*", "", "".join(pieces)).replace("xlink:href", "href")

    def _draw(self, part: Part, room: float) -> Any:
        if (text := literal_text(part)) is not None:
            return railroad.Terminal(text)
        match part:
            case Reference():
                address = f"{self._page_address(part.file)}#{anchor(part)}"
                return railroad.NonTerminal(plain_name(part.name), href=address)
            case Choice(parts):
                return railroad.Choice(0, *(self._draw(one, room - _BRANCH) for one in parts))
            case Repetition(inner, "?"):
                return railroad.Optional(self._draw(inner, room - _BRANCH))
            case Repetition(inner, mark):
                width = room - _LOOP - (_BRANCH if mark == "*" else 0)
                return (railroad.ZeroOrMore if mark == "*" else railroad.OneOrMore)(self._draw(inner, width))
            case Sequence(parts):
                return self._sequence(parts, room)
        raise TypeError(f"no diagram of {part}")

    def _sequence(self, parts: tuple[Part, ...], room: float) -> Any:
        """Return the parts in one line, or in several lines if they need more room."""
        items = self._items(parts, room)
        if sum(one.width + 20 for one in items) > room:
            items = self._items(parts, room - 3 * _LOOP)
        lines: list[list[Any]] = [[]]
        width = 0.0
        for item in items:
            if lines[-1] and width + item.width + 20 > room - 2 * _LOOP:
                lines.append([])
                width = 0.0
            lines[-1].append(item)
            width += item.width + 20
        if sum(one.width + 20 for one in items) <= room or len(lines) == 1:
            return railroad.Sequence(*items)
        return railroad.Stack(*(railroad.Sequence(*line) for line in lines))

    def _items(self, parts: tuple[Part, ...], room: float) -> list[Any]:
        """Return the drawings of parts; `a ("," a)*` becomes a loop around `a` with `,` on the way back."""
        items: list[Any] = []
        for index, part in enumerate(parts):
            match part:
                case Repetition(Sequence((*separators, repeated)), "*") if index and repeated == parts[index - 1]:
                    back = [self._draw(one, room) for one in reversed(separators)]
                    items[-1] = railroad.OneOrMore(
                        self._draw(repeated, room - _LOOP), railroad.Sequence(*back) if len(back) > 1 else back[0]
                    )
                case _:
                    items.append(self._draw(part, room))
        return items


def anchor(rule: Reference) -> str:
    """Return the part of an address that leads to the diagram of a rule on the page of its grammar."""
    return f"{rule.file}-{rule.name.strip('_').lower()}".replace("_", "-")


class Railroad(SphinxDirective):
    """Draws the named rules of a grammar; without names, all rules that its file defines, each in a section."""

    required_arguments = 1
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Return the diagrams."""
        file, *names = " ".join(self.arguments).split()
        grammar = read_grammar_file(file)
        unknown = [name for name in names if name not in grammar.rules]
        if unknown:
            raise self.error(f"{file}.lark has no rule `{unknown[0]}`; its rules: {', '.join(grammar.rules)}")
        self.env.note_dependency(f"../grammars/{file}.lark")
        if names:
            return [self._figure(grammar.resolve(name)) for name in names]
        return [self._section(rule) for rule in shown_rules(file)]

    def _section(self, rule: Reference) -> nodes.section:
        section = nodes.section(ids=[anchor(rule)], names=[anchor(rule)])
        section += nodes.title("", plain_name(rule.name).capitalize())
        section += self._figure(rule)
        self.state.document.note_explicit_target(section)
        return section

    def _figure(self, rule: Reference) -> nodes.Node:
        text = f"<pre>{escape(rule_text(rule))}</pre>"
        if isinstance(definition_of(rule), Pattern):
            return nodes.raw("", f'<div class="railroad">{text}</div>', format="html")
        svg = Drawing(self._page_address).svg(rule)
        words = f"<details><summary>As text</summary>{text}</details>"
        return nodes.raw(
            "", f'<div class="railroad"><div class="railroad-scroll">{svg}</div>{words}</div>', format="html"
        )

    def _page_address(self, file: str) -> str:
        target = PAGES[file]
        here = posixpath.dirname(self.env.docname)
        return "" if target == self.env.docname else f"{posixpath.relpath(target, here or '.')}.html"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_directive("railroad", Railroad)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
