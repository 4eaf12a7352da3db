"""The directive `codes`: the explanations of all diagnostic codes of a kind, a section for each.

```{codes} query
```

writes a section for each code of `envgraph/cli/codes/query.toml`, with an anchor such as `#used-once`. Without a kind
it writes a table of all codes with links to their sections.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from envgraph.cli._help_command import KINDS, CodeExplanation, example_place, load_explanations


def parse_inline(text: str) -> list[nodes.Node]:
    """Return the nodes of a text in which names stand between backquotes."""
    parts = re.split(r"(`[^`]+`)", text)
    return [nodes.literal("", part.strip("`")) if part.startswith("`") else nodes.Text(part) for part in parts if part]


def make_paragraph(text: str) -> nodes.paragraph:
    """Return a paragraph of a text in which names stand between backquotes."""
    return nodes.paragraph("", "", *parse_inline(text))


def make_code(text: str, language: str = "text") -> nodes.literal_block:
    """Return a block of code, which may have mistakes: text that the language does not know is no warning."""
    shown = text.strip("\n")
    return nodes.literal_block(shown, shown, language=language, force=True, xml_space="preserve")


def make_table(head: list[str], rows: list[list[list[nodes.Node]]]) -> nodes.table:
    """Return a table; a cell is a list of inline nodes."""
    group = nodes.tgroup("", *(nodes.colspec(colwidth=1) for _ in head), cols=len(head))
    cells = [[[nodes.Text(text)] for text in head], *rows]
    made = [nodes.row("", *(nodes.entry("", nodes.paragraph("", "", *cell)) for cell in row)) for row in cells]
    group += [nodes.thead("", made[0]), nodes.tbody("", *made[1:])]
    return nodes.table("", group)


class Codes(SphinxDirective):
    """The directive; its argument is a kind of codes."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the sections of a kind, or the table of all codes."""
        known = load_explanations()
        if not self.arguments:
            return [node for kind in KINDS for node in _overview(kind, known)]
        kind = self.arguments[0]
        if kind not in KINDS:
            raise self.error(f"unknown kind of codes: {kind}")
        return [_section(one) for one in known.values() if one.kind == kind]


def _overview(kind: str, known: dict[str, CodeExplanation]) -> Iterator[nodes.Node]:
    rows = []
    for one in (one for one in known.values() if one.kind == kind):
        link = nodes.reference("", "", nodes.literal("", one.code), refuri=f"codes/{kind}.html#{one.code}")
        rows.append([[link], parse_inline(re.split(r"(?<=\.)\s", one.means, maxsplit=1)[0])])
    title = nodes.title("", KINDS[kind])
    yield nodes.section("", title, make_table(["code", "means"], rows), ids=[f"codes-{kind}"], names=[kind])


def _section(one: CodeExplanation) -> nodes.section:
    title = nodes.title("", "", nodes.literal("", one.code), nodes.Text(f" ({one.severity})"))
    section = nodes.section("", title, make_paragraph(one.means), ids=[one.code], names=[one.code])
    section += nodes.paragraph("", "", nodes.strong("", "Cure: "), *parse_inline(one.cure))
    if one.wrong:
        for file, text in one.also.items():
            if text:
                section += [make_paragraph(f"With, {example_place(file)}:"), make_code(text, _language(file))]
        section += [make_paragraph(f"Wrong, {example_place(one.file)}:"), make_code(one.wrong, _language(one.file))]
        section += make_code(one.messages())
        if one.right:
            section += [make_paragraph("Right:"), make_code(one.right, _language(one.file))]
    if one.shell:
        section += [make_paragraph("Reported by:"), make_code(one.shell, "sh")]
    return section


def _language(file: str) -> str:
    ending = file.rpartition(".")[2]
    return {"ecore": "xml", "xmi": "xml", "toml": "toml", "json": "text"}.get(ending, ending)


def _add_anchors(app: Sphinx, doctree: nodes.document) -> None:
    """Let links in Markdown lead to the sections: MyST knows only the headings that it reads."""
    slugs = app.env.metadata[app.env.docname].setdefault("myst_slugs", {})
    for section in doctree.findall(nodes.section):
        for name in section["ids"]:
            slugs.setdefault(name, (section.line or 0, name, section[0].astext()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("codes", Codes)
    app.connect("doctree-read", _add_anchors)
    return {"parallel_read_safe": True}
