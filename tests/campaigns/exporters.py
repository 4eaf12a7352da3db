"""Families with hostile names through every exporter and template: what is made can be read, and text stays text."""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from random import Random
from types import ModuleType, SimpleNamespace
from typing import Any, Final
from unittest import mock
from xml.etree import ElementTree

import gymnasium
import numpy as np
from markdown_it import MarkdownIt

from envgraph.cli import _adopt_command, _export_command
from envgraph.env import adopt
from envgraph.errors import EnvgraphError
from envgraph.graph import model_to_json, model_to_xmi
from envgraph.lang import Bundle, model_to_text
from envgraph.lang.write._term_writer import format_string
from envgraph.metamodel import metamodel_to_ecore
from envgraph.report import family_report, render_html
from envgraph.search import Domain, Family, Member, open_family, write_family
from envgraph.search.export import write_package

FORMATS: Final = _export_command._EXPORT_FORMATS
"""Every format of `envgraph export`."""

CODE: Final = "__import__('pathlib').Path('CANARY').touch()"
"""Makes a file where it runs."""

SCRIPT: Final = f"<script>{CODE}</script><img src=x onerror={CODE}>"

NAMES: Final = (
    f"{{{CODE}}}",
    f'"""\n{CODE}\n"""',
    f"'''\n{CODE}\n'''",
    f'"+{CODE}+"',
    f"'+{CODE}+'",
    f"\n{CODE}\r{CODE}\x0b\x0c\x85{CODE}\u2028{CODE}\u2029#",
    f"`{CODE}`\n```\n{SCRIPT}\n```\n[x](javascript:{CODE}) [y]: javascript:{CODE}",
    f'"; {CODE} //',
    f"*/ {CODE} /*",
    f"--> ]]> {SCRIPT} <!-- <![CDATA[",
    f"{SCRIPT}&lt;script&gt;\\<b>",
    f"exec({CODE})",
    "\\",
    '\\"',
    "\\N{BULLET}",
    "\\x",
    "\\u12",
    "\u202eB\u2066A\u200b\ufeff",
    "\x1b]0;own\x07\x9b31m\x7f\x08",
    "\0",
    "class",
    "a" * 245,
    "{{ 7*7 }}",
    "{% raw %}",
    "{#",
    "%s %(a)s {0} ${HOME} $(touch CANARY)",
    "#",
    "=1+1",
    "",
    " ",
    "..",
    "../../CANARY",
    "/CANARY",
    "é🔥\U000e0041",
)

_PIECES: Final = (
    *NAMES,
    *"\"'\\`{}()[]<>&#%$@!?;:=*/-+|~^,. \n\r\t\0aE1é",
    '"""',
    "'''",
    "\\\n",
    CODE,
    SCRIPT,
    "}}",
    "%}",
)

YARD: Final = {
    "yard.metamodel": """metamodel yard
/** DOC */
class World { contains Cell[1..*] cells  contains Place[*] places  contains Robot[1] robot }
@key(y, x) abstract class Cell {
    int x  int y  string ^class
    refers Cell[0..1] right opposite left  refers Cell[0..1] left opposite right
    refers Cell[0..1] down opposite up  refers Cell[0..1] up opposite down
}
@glyph("<", "#b0b0b0") class ^class extends Cell
@glyph("\\"", "#2f9e44") class exec extends Cell
@key(name) class Place { string name }
class Robot { refers Cell[1] at  string __import__  bool happy = true }""",
    "yard.model": """import "yard.metamodel"
model yard : yard {
    world : World {
        cells = grid cell { column x next right  row y next down  rows "<\\"" }
        places = [ PLACES ]
        robot = robot : Robot { at = cell[0, 0], __import__ = FIRST }
    }
}""",
    "yard.query": """package yard
import "yard.metamodel"
pattern goal(r : Robot) { Robot.at(r, c); exec(c); }
pattern some(c : exec) { exec(c); }
pattern named(r : Robot, n : string) { Robot.__import__(r, n); }""",
    "yard.rules": """package yard
import "yard.query"
derive terrain = retype among { ^class, exec };
rule go(r : Robot, p : Place) {
    lhs { r -at-> here : Cell -right-> there : Cell; Place.name(p, n); }
    modify { set r.at = there; }
}""",
    "yard.environment": """import "yard.rules"
environment ﬁYard(robot : Robot) {
    action go(p : Place) = go(robot, p)
    on find goal(robot) reward 1.0 terminate success
    observe robot.at among Cell
    OBSERVED
    limit 10 steps
    draw grid Cell at (x, y) with robot at robot.at
}""",
    "family.toml": """name = "yard"
model = "yard.model"
environment = "yard.environment"
measures.MEASURE = { kind = "count", of = "some" }
diversity = { kind = "variance", of = MEASURE }
mutation = { rules = ["terrain"] }""",
}
"""A small domain, whose models, clauses and measures have words in capitals where texts are filled in."""

TEMPLATES: Final = {
    "raw.py.j2": '''"""{{ name }}{{ actions }}{{ observed }}"""
# {{ name }} {{ actions | join("#") }}
a = "{{ name }}", '{{ name }}', """{{ name }}""", f"{{ name }}", {{ name | python }}, {{ name | json }}
b = {{ actions | python }}, [{% for one in members %}{{ one.name | python }}, "{{ one.name }}"
, {% endfor %}]
''',
    "raw.toml.j2": 'a = ["{{ name }}", """{{ name }}""", {{ name | json }}] # {{ name }}\n',
    "raw.json.j2": '["{{ name }}", {{ name | json }}, {{ actions | json }}]',
    "raw.md.j2": "# {{ name }}\n\n`{{ name }}` {{ name }} {{ name | markdown }}\n\n```\n{{ name }}\n```\n\n"
    "- {{ observed | join('\n\n') }}\n\n{{ name }}\n\n| {{ name | markdown }} | {{ actions }} |\n|---|---|\n",
    "raw.html.j2": '<p title="{{ name }}" id={{ name }}><!-- {{ name }} -->{{ name }}</p>\n'
    '<script>a = "{{ name }}"; b = {{ name | json }}; c = `{{ name }}`</script>',
    "raw.xml.j2": "<a b=\"{{ name }}\" c='{{ name }}'>{{ name }}{{ actions }}</a>",
}
"""Templates of a user that forget filters; `python` and `json` are used where there are no quotes."""


class _Fragile(HTMLParser):
    """Knows tags and attributes that run what stands in them."""

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        assert tag not in ("img", "iframe"), tag
        assert not any(re.fullmatch("on[a-z]+", name) for name, _ in attrs), attrs


def prepare() -> None:
    """Read what all cases need once."""
    lake()
    doors(CODE)


def campaign(random: Random) -> str:
    """Export a family with random names to every format."""
    names = ["".join(random.choice(_PIECES) for _ in range(random.choice([1, 1, 2, 3, 6, 20])))[:300] for _ in range(3)]
    kind = random.choice(["yard", "yard", "lake", "doors", "templates"])
    with tempfile.TemporaryDirectory() as directory, contextlib.chdir(directory):
        folder = Path(directory)
        match kind:
            case "yard":
                exported(yard(names), folder, FORMATS)
                read_models(yard(names))
            case "lake":
                exported(named(lake(), names), folder, FORMATS)
            case "doors":
                exported(doors(random.choice(names)), folder, ("minigrid",))
            case _:
                own_templates(yard(names), folder)
        check(folder)
        use(folder)
        assert not list(folder.rglob("CANARY*"))
    return kind


# --- families


def yard(names: Sequence[str]) -> Family:
    """A family whose name, members, measure, places, clauses and documentation have these names."""
    first, distinct = names[0], [*dict.fromkeys(names)]
    measure = "".join(c for c in names[-1] if c <= "\uffff") or "none"  # JSON names no others as TOML does
    words = {
        "DOC": first.replace("*/", "* /"),
        "PLACES": " ".join(f"p{n} : Place {{ name = {format_string(name)} }}," for n, name in enumerate(distinct[:3])),
        "FIRST": format_string(first),
        "OBSERVED": " ".join(f"observe robot.happy if find named(robot, {format_string(name)})" for name in names),
        "MEASURE": json.dumps(measure).replace("\x7f", "\\u007f"),
    }
    texts = {file: re.sub("|".join(words), lambda found: words[found[0]], text) for file, text in YARD.items()}
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    model = write_model(domain)
    members = tuple(Member(name, {measure: 1.0}, model) for name in distinct)
    return Family(first, domain.workspace.bundle(), members, domain)


def write_model(domain: Domain) -> str:
    """The model of a domain as JSON."""
    return json.dumps(model_to_json(domain.engine().model))


@cache
def lake(said: str = "a lake") -> Family:
    """FrozenLake, adopted."""
    adopted, _ = adopt("FrozenLake-v1", 0, is_slippery=False)
    kind, words = next(_adopt_command._candidate_templates(adopted))
    assert kind == "grid"
    return of_texts("grid", {**words, "said": said, "id": said})


def named(family: Family, names: Sequence[str]) -> Family:
    """A family with other names."""
    found = [replace(family.members[0], name=name) for name in dict.fromkeys(names)]
    return Family(names[0], family.bundle, tuple(found), family.domain)


@cache
def doors(said: str = "get to the goal") -> Family:
    """A level of MiniGrid, adopted, with a mission and colours that are any text, and a class that is a function."""
    things = [
        SimpleNamespace(name="thing0", cls="Key", colour="red", place=(1, 1), inside=None),
        SimpleNamespace(name="thing1", cls="Box", colour="red", place=(2, 1), inside="thing0"),
    ]
    level = SimpleNamespace(
        mission=said, success_kind="goal", doors=[], objects=things, rows=["####", "#..#", "#.G#", "####"],
        start=(1, 2), start_direction="east", exit=None,
    )  # fmt: skip
    return of_texts("minigrid", {"level": level, "said": said, "id": said})


def of_texts(kind: str, words: Mapping[str, Any]) -> Family:
    """The family of one member that the templates of `envgraph adopt` make."""
    rendered = _adopt_command.render_domain(f"adopt/{kind}", "adopted", {"limit": 20, **words})
    texts = {file: _adopt_command._format_file(file, text) for file, text in rendered.items()}
    if kind == "minigrid":
        metamodel = texts["adopted.metamodel"].replace("@colour Colour colour", "string colour")
        texts["adopted.metamodel"] = f"{metamodel}class exec extends Thing\n"
        model = texts["adopted.model"].replace("::red", format_string(words["said"]))
        texts["adopted.model"] = model.replace(": Key", ": exec")
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    if kind == "minigrid":
        assert domain.engine().model.nodes("Level")[0].mission == words["said"]
    measures = {one.name: 1.0 for one in domain.spec.measures}
    member = Member("E1", measures, write_model(domain), initial=True)
    return Family("Adopted", domain.workspace.bundle(), (member,), domain)


# --- files


def exported(family: Family, folder: Path, formats: Sequence[str]) -> set[str]:
    """Export a family; returns the formats that were not refused."""
    made = set()
    folder.mkdir(exist_ok=True)
    (folder / "family.json").write_text(write_family(family), "utf-8")
    read = open_family(folder / "family.json")
    for format in formats:
        output = folder / format
        if format not in _export_command._FOLDER_FORMATS:
            output = output.with_suffix({"svg": ".svg", "npz": ".npz"}.get(format, ".json"))
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.suppress(EnvgraphError),
            mock.patch.object(_export_command, "open_family", lambda *_: read),  # what was explored is kept
        ):
            _export_command.export_family(str(folder / "family.json"), folder, format, output)
            made.add(format)
    (folder / "page.html").write_text(render_html(family_report(read)), "utf-8")
    return made


def own_templates(family: Family, folder: Path) -> None:
    """Write what templates make that forget filters; the texts are those of the family."""
    (folder / "templates").mkdir(parents=True)
    for name, text in TEMPLATES.items():
        (folder / "templates" / name).write_text(text, "utf-8")
    write_package(family, folder / "own", folder / "templates")
    name, found = family.name, dict[str, Any]()
    tree = ast.parse((folder / "own" / "raw.py").read_text("utf-8"))
    for one in tree.body[1:]:
        assert isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name)
        found[one.targets[0].id] = one.value
    assert [texts(one) for one in found["a"].elts[:5]] == [name] * 5
    actions = family.explored(family.members[0]).tabular.action_names
    assert ast.literal_eval(found["b"].elts[0]) == actions
    assert ast.literal_eval(found["b"].elts[1])[::2] == [one.name for one in family.members]
    assert tomllib.loads((folder / "own" / "raw.toml").read_text("utf-8"))["a"] == [name] * 3
    given = json.loads((folder / "own" / "raw.json").read_text("utf-8"))
    assert given == [name, name, [*actions]]


def texts(node: ast.expr) -> object:
    """The value of a string, or of one with the letter f before it in which nothing is calculated."""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(ast.literal_eval(one)) for one in node.values)
    return ast.literal_eval(node)


def read_models(family: Family) -> None:
    """Write a model and its metamodel in all formats, and read them."""
    model = family.model(family.members[0])
    ElementTree.fromstring(metamodel_to_ecore(model.metamodel))
    with contextlib.suppress(EnvgraphError):
        ElementTree.fromstring(model_to_xmi(model))
    dot, svg = model.picture().to_dot(), model.picture().to_svg(graphviz=False)
    for label in re.findall(r"label=<(.*)>\];", dot):
        ElementTree.fromstring(label.replace("&nbsp;", " "))
    check_text(dot)
    check_svg(svg)
    assert family.domain.behaviour is not None
    assert "Robot" in model_to_text(model)


def check(folder: Path) -> None:
    """Parse all files, and look for what would run."""
    for path in sorted(folder.rglob("*")):
        if "templates" in path.parts or not path.is_file():
            continue
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                assert all(arrays[name] is not None for name in arrays)
            continue
        text = path.read_text("utf-8")
        match path.suffix:
            case ".py":
                check_python(text)
            case ".toml":
                tomllib.loads(text)
            case ".json":
                json.loads(text)
                continue  # control characters are escaped, others may stand in JSON
            case ".svg":
                check_svg(text)
            case ".xml":
                ElementTree.fromstring(text)
            case ".md":
                check_markdown(text)
            case ".html":
                _Fragile().feed(text)
                assert "own" in path.parts or "<script" not in text.replace('<script id="sorting">', "")
        check_text(text)


def check_text(text: str) -> None:
    """No character is obeyed or hidden, but of planes that editors do not know."""
    assert all(c.isprintable() or c in "\n\u2009" or c > "\uffff" for c in text)


def check_python(text: str) -> None:
    """Parse code; nothing in it is that of a name."""
    for node in ast.walk(ast.parse(text)):
        assert not (isinstance(node, ast.Name) and node.id == "__import__"), ast.unparse(node)
        assert not isinstance(node, ast.FormattedValue) or "CANARY" not in ast.unparse(node)


def check_markdown(text: str) -> None:
    """Nothing in Markdown becomes HTML, or a link that runs."""
    parser = MarkdownIt("commonmark", {"html": True}).enable("table")
    parser.validateLink = lambda _: True  # type: ignore[assignment, method-assign]
    waiting = parser.parse(text)
    while waiting:
        token = waiting.pop()
        assert token.type not in ("html_block", "html_inline", "image"), token.content
        assert "javascript" not in str(token.attrs.get("href", "")), token.attrs
        waiting += token.children or []


def check_svg(text: str) -> None:
    """A picture is XML without scripts."""
    for element in ElementTree.fromstring(text).iter():
        assert element.tag.rpartition("}")[2] not in ("script", "img", "foreignObject")
        assert not any(name.startswith("on") for name in element.attrib)


def use(folder: Path) -> None:
    """Import what was made, and make environments of it."""
    paths = [str(folder / "minigrid"), str(folder / "python/src"), str(folder), *sys.path]
    with (
        mock.patch.dict(sys.modules, {"numba": None, **dict(_minigrid())}),
        mock.patch.dict(gymnasium.registry),
        mock.patch.object(sys, "path", paths),
    ):
        if (folder / "python/src").is_dir():
            made: Any = importlib.import_module("python")
            for member in made.MEMBERS:
                made.make(member).reset(seed=0)
        if (folder / "compiled").is_dir():
            made = importlib.import_module("compiled")
            made.Environments(num_envs=2).reset(seed=0)
        if (folder / "minigrid/levels.py").is_file():
            made = importlib.import_module("levels")
            for level in made.LEVELS:
                with contextlib.suppress(KeyError):
                    made.Level(level)._gen_grid(1, 1)


def _minigrid() -> Iterator[tuple[str, ModuleType]]:
    """Modules in place of those of MiniGrid, which need not be there."""
    for name in ("", ".core", ".core.grid", ".core.mission", ".core.world_object", ".minigrid_env"):
        module: Any = ModuleType(f"minigrid{name}")
        for kind in ("Ball", "Box", "Door", "Floor", "Goal", "Key", "Lava", "Wall", "MissionSpace"):
            setattr(module, kind, type(kind, (), {"__init__": lambda self, *_, **__: None}))
        module.MiniGridEnv = module.Ball
        module.Grid = lambda *_: SimpleNamespace(set=lambda *_: None, get=lambda *_: None)
        yield module.__name__, module


if __name__ == "__main__":
    for folder in map(Path, sys.argv[1:]):
        os.chdir(folder)
        use(folder)
