"""The directive `commands`: a section for each command of `envgraph`, from the declarations of the commands.

The lines in the directive are examples. Each belongs to the command that it calls:

```{commands}
envgraph check maze
```
"""

from __future__ import annotations

import click
from codes import make_code, make_paragraph, parse_inline
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import envgraph.cli  # noqa: F401, it declares the commands
from envgraph.cli._app import app as program


class Commands(SphinxDirective):
    """The directive."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the sections of all commands, in the order of `envgraph --help`."""
        root = click.Context(program, info_name="envgraph", show_default=True)
        made = []
        for name, command in program.commands.items():
            examples = [line for line in self.content if line.split()[1:2] == [name]]
            made.append(_section(click.Context(command, root, name), command, name, examples))
        return made


def _section(context: click.Context, command: click.Command, name: str, examples: list[str]) -> nodes.section:
    title = nodes.title("", "", nodes.literal("", f"envgraph {name}"))
    section = nodes.section("", title, ids=[name], names=[name])
    section += make_code(" ".join([context.command_path, *command.collect_usage_pieces(context)]), "sh")
    section += [make_paragraph(" ".join(text.split())) for text in (command.help or "").split("\n\n")]
    if examples:
        section += [nodes.paragraph("", "", nodes.strong("", "Examples")), make_code("\n".join(examples), "sh")]
    records = [(one, one.get_help_record(context)) for one in command.get_params(context)]
    rows = [(one, record) for one, record in records if record and "--help" not in one.opts]
    for kind, title_text in ((click.Argument, "Arguments"), (click.Option, "Options")):
        items = [_item(*record) for one, record in rows if isinstance(one, kind)]
        if items:
            section += [nodes.paragraph("", "", nodes.strong("", title_text)), nodes.definition_list("", *items)]
    return section


def _item(words: str, meaning: str) -> nodes.definition_list_item:
    term = nodes.term("", "", nodes.literal("", words.replace("INTEGER RANGE", "N")))
    return nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph("", "", *parse_inline(meaning))))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
