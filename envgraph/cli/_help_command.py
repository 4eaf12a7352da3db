"""The command `envgraph help`: explain the codes of errors and warnings, or print the help of a command.

The explanations are in `codes/KIND.toml`, a table for each code. Their examples are texts for the domain that
`envgraph new maze` writes. The message of an example is never stored: the example is read and checked when it is shown.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from importlib.resources import files
from typing import Final

import click

from envgraph.cli._output import print_json, print_lines, print_styled_lines, print_table
from envgraph.code import dataclass
from envgraph.errors import WARNING_CODES, Diagnostic, InvalidArgument, LoadError, did_you_mean

KINDS: Final = {
    "text": "Any file",
    "metamodel": "Metamodels",
    "model": "Models",
    "query": "Queries",
    "rules": "Rules and units",
    "environment": "Environments",
    "family": "Families and problems",
    "interchange": "Files of other tools, and levels",
    "running": "While a command runs",
}
"""The titles of the kinds of codes. Each kind is a file `codes/KIND.toml`."""

_STYLES: Final = {
    **{"error `": "bold red", "warning `": "bold yellow", "Cure:": "green", "hint:": "cyan"},
    **dict.fromkeys(("with, ", "wrong, ", "right:", "reported by:"), "bold"),
}
"""The styles of lines on a terminal, by how they begin."""
_BLOCK_FILES: Final = ("maze.environment", "maze.model")
"""The files that consist of one block. An example stands at its end."""
_ECORE: Final = (
    '<ecore:EPackage xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" '
    'name="example" nsURI="http://example.org/example" nsPrefix="example">\n'
)
"""The begin of `example.ecore`: its examples are the content of this tag."""


@dataclass(frozen=True, slots=True)
class CodeExplanation:
    """The explanation of a diagnostic code.

    Attributes:
        kind: the key in `KINDS`.
        means: what is wrong.
        cure: how to correct the problem.
        wrong, right: the same text with and without the problem; empty if no text can have it.
        file: the file of the example. A file of the domain `maze` is continued by the text, any other consists of it.
        also: texts that continue other files of the domain, for both examples.
        shell: commands that report the code, if no text can have the problem.
    """

    code: str
    kind: str
    means: str
    cure: str
    wrong: str = ""
    right: str = ""
    file: str = ""
    also: Mapping[str, str] = field(default_factory=dict)
    shell: str = ""

    @property
    def severity(self) -> str:
        """Return "warning" if the code is mainly that of a warning, otherwise "error"."""
        return "warning" if self.code in WARNING_CODES else "error"

    def wrong_diagnostics(self) -> list[Diagnostic]:
        """Return the problems of the domain `maze` with the wrong text."""
        return _diagnose_example({**self.also, self.file: self.wrong}, self.file)

    def right_diagnostics(self) -> list[Diagnostic]:
        """Return the problems of the domain `maze` with the right text."""
        return _diagnose_example({**self.also, self.file: self.right}, self.file)

    def messages(self) -> str:
        """Return the text that `envgraph check` prints about the wrong text; empty without an example."""
        found = self.wrong_diagnostics() if self.wrong else []
        return "\n\n".join(str(one) for one in found if one.code == self.code)

    def to_dict(self) -> dict[str, object]:
        """Return the explanation as JSON-ready data; missing parts are empty."""
        data = {name: getattr(self, name) for name in ("code", "kind", "severity", "means", "cure", "file", "also")}
        return {**data, "wrong": self.wrong, "message": self.messages(), "right": self.right, "shell": self.shell}


def load_explanations() -> dict[str, CodeExplanation]:
    """Return the explanations of all codes, by kind and then by name."""
    found: dict[str, CodeExplanation] = {}
    for kind in KINDS:
        data = tomllib.loads(files("envgraph.cli").joinpath("codes", f"{kind}.toml").read_text(encoding="utf-8"))
        usual = "family.toml" if kind == "family" else f"maze.{kind}"
        for code in sorted(data):
            place = data[code].setdefault("file", usual) if "wrong" in data[code] else ""
            found[code] = CodeExplanation(code, kind, **{**data[code], "file": place})
    return found


def print_help(names: Sequence[str]) -> None:
    """Print the explanations of codes and the help of commands; without names, list all codes."""
    known = load_explanations()
    commands = click.get_current_context().find_root().command
    assert isinstance(commands, click.Group)
    if not names:
        _list_codes(known)
        return
    for name in names:
        if name not in known and name not in commands.commands:
            hint = did_you_mean(name, [*known, *commands.commands]) or "`envgraph help` lists all codes"
            raise InvalidArgument(f"there is no code and no command `{name}`", hint)
    if print_json(lambda: [known[name].to_dict() for name in names if name in known]):
        return
    for number, name in enumerate(names):
        if name in known:
            print_styled_lines("\n" * bool(number) + "\n".join(_explanation_lines(known[name])), _STYLES)
        else:
            root = click.get_current_context().find_root()
            command = commands.commands[name]
            print_lines(command.get_help(click.Context(command, root, name)))


def _list_codes(known: dict[str, CodeExplanation]) -> None:
    if print_json(lambda: [one.to_dict() for one in known.values()]):
        return
    for kind, title in KINDS.items():
        rows = [
            (one.code, re.split(r"(?<=\.)\s", one.means, maxsplit=1)[0]) for one in known.values() if one.kind == kind
        ]
        print_table(title, ("code", "means"), rows)
        print_lines("")
    print_lines("next: `envgraph help CODE` explains a code, `envgraph help COMMAND` a command")


def _explanation_lines(one: CodeExplanation) -> Iterator[str]:
    yield f"{one.severity} `{one.code}` ({KINDS[one.kind].lower()})"
    yield f"\n{one.means}\nCure: {one.cure}"
    if one.wrong:
        for file, text in one.also.items():
            yield f"\nwith, {example_place(file)}:\n\n{_indented(text)}"
        yield f"\nwrong, {example_place(one.file)}:\n\n{_indented(one.wrong)}\n\n{one.messages()}"
        yield f"\nright:\n\n{_indented(one.right or '(leave it out)')}"
    if one.shell:
        yield f"\nreported by:\n\n{_indented(one.shell)}"


def example_place(file: str) -> str:
    """Return where the text of an example stands: in a file of the domain `maze`, or alone in a file."""
    if file == "family.toml":
        return "`family.toml` of a new domain `maze`"
    if file.startswith("maze."):
        block = "the block of " if file in _BLOCK_FILES else ""
        return f"at the end of {block}`{file}` of a new domain `maze`"
    return f"inside of the package of `{file}`" if file == "example.ecore" else f"`{file}`"


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" if line else "" for line in text.strip("\n").split("\n"))


def _diagnose_example(examples: Mapping[str, str], file: str) -> list[Diagnostic]:
    """Return the problems of a file in a new domain `maze` whose files are continued or added by examples."""
    from envgraph.editor import find_problems
    from envgraph.lang import TextFiles, load_workspace

    needed = ["maze.metamodel"] if file.endswith((".xmi", ".json")) else []
    try:
        return find_problems(load_workspace([*needed, file], files=TextFiles(example_texts(examples))))
    except LoadError as error:
        return list(error.diagnostics)


def example_texts(examples: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a new domain `maze` with examples by file name: each is added to its file or a new one."""
    from envgraph.cli._new_command import render_domain

    texts = render_domain("new", "maze", {})
    for name, example in examples.items():
        if name == "family.toml":
            texts[name] = _replace_tables(texts[name], example)
        elif name in _BLOCK_FILES:  # the example stands at the end of the last block
            head, brace, _ = texts[name].rpartition("}")
            texts[name] = f"{head}\n{example.strip()}\n{brace}\n"
        elif name == "example.ecore":
            texts[name] = f"{_ECORE}{example}</ecore:EPackage>\n"
        else:
            texts[name] = f"{texts[name]}\n{example.strip()}\n" if name in texts else example
    return texts


def _replace_tables(text: str, example: str) -> str:
    """Return a family file with the tables of an example in place of its own, and with the keys at its top."""
    keys: dict[str, str] = {}
    tables: dict[str, str] = {}
    for whole in (text, example):
        top, *rest = re.split(r"^(?=\[)", whole, flags=re.MULTILINE)
        keys |= {line.partition("=")[0].strip(): line for line in top.splitlines() if "=" in line}
        tables |= {one.partition("]")[0]: one.rstrip() for one in rest}
    return "\n".join([*keys.values(), *tables.values(), ""])
