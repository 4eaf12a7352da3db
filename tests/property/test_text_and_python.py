"""Nothing in a query file reaches Python: any name and any literal is only ever a name and a value."""

from __future__ import annotations

import builtins
import keyword

from hypothesis import assume, example, given, strategies as st

from envgraph.graph import Model
from envgraph.lang import TextFiles, load_workspace
from envgraph.match import FREE
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher

OURS = (
    "view",
    "build",
    "out",
    "add",
    "seen",
    "todo",
    "node",
    "model",
    "k",
    "k0",
    "v0",
    "v1",
    "t0",
    "E0",
    "F0",
    "C",
)
NAMES = sorted(
    {
        *keyword.kwlist,
        *keyword.softkwlist,
        *dir(builtins),
        *dir(object),
        *dir(type),
        *OURS,
        *(
            "self",
            "s",
            "cls",
            "__name__",
            "__dict__",
            "__globals__",
            "__builtins__",
            "os",
            "sys",
            "int",
            "string",
        ),
        *("_add", "_fn_abs", "EvaluationError", "FREE", "None", "é", "数"),
    }
)
"""Names that mean something to Python, or to the generated code."""
ELSEWHERE = {"int", "float", "bool", "string", "true", "false", "TRUE", "FALSE", "none", "java"}
"""Names of data types and values, which cannot be names of classes."""

NASTY = [
    "'",
    '"',
    '"""',
    "\\",
    "\n",
    "{x}",
    "%s",
    "{0.__class__}",
    "'); __import__('os').abort(); ('",
    '" + str(k) + "',
    "\x00",
    "\u2028",
    "${x}",
    "#{1}",
    "\N{RIGHT-TO-LEFT OVERRIDE}",
]


def quoted(text: str) -> str:
    """A literal of the query language."""
    escapes = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"}
    return '"' + "".join(escapes.get(letter, letter) for letter in text) + '"'


def engine_of(metamodel: str, query: str) -> Engine:
    files = TextFiles({"m.metamodel": metamodel, "q.query": 'import "m.metamodel"\n' + query})
    workspace = load_workspace(["q.query"], files=files)
    assert not workspace.errors, "\n\n".join(map(str, workspace.errors))
    assert workspace.metamodel is not None
    engine = Engine(Model(workspace.metamodel))
    engine.add(*workspace.definitions)
    return engine


@given(st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=20))
@example("".join(NASTY))
def test_any_string_literal_is_compiled_as_a_value(text: str) -> None:
    query = f"""
        pattern stored(x : Node) {{ Node.label(x, {quoted(text)}); }}
        pattern other(x : Node) {{ Node.label(x, label); label != {quoted(text)}; }}
        pattern compared(x : Node) {{ check(x.label == {quoted(text)} && !("" + {quoted(text)} != x.label)); }}
        pattern computed(x : Node, t : string) {{ Node(x); t == eval("<" + {quoted(text)} + ">"); }}
        pattern absent(x : Node) {{ neg Node.label(x, {quoted(text)}); }}
        pattern counted(n : int) {{ n == count Node.label(_, {quoted(text)}); }}
    """
    engine = engine_of("metamodel m class Node { string label }", query)
    one = engine.model.create("Node", label=text)
    two = engine.model.create("Node", label=text + "x")
    expected = {
        "stored": [(one.id,)],
        "other": [(two.id,)],
        "compared": [(one.id,)],
        "computed": [(one.id, f"<{text}>"), (two.id, f"<{text}>")],
        "absent": [(two.id,)],
        "counted": [(1,)],
    }
    for matcher in (engine.matcher, NaiveMatcher(engine.model, engine.library)):
        found = {name: matcher.rows(name, (FREE,) * len(rows[0])) for name, rows in expected.items()}
        assert {name: sorted(rows) for name, rows in found.items()} == expected


NAME = st.sampled_from(NAMES)


@given(st.lists(NAME, min_size=7, max_size=7, unique=True))
@example(["__class__", "s", "self", "def", "lambda", "import", "None"])
@example(["_", "__x", "_x", "x", "__", "___", "_1"])
def test_any_identifier_is_compiled_as_a_name(names: list[str]) -> None:
    cls, reference, attribute, pattern, *variables = (f"^{name}" for name in names)
    assume(not {cls[1:], reference[1:], attribute[1:]} & ELSEWHERE)
    # A name that starts with `_` is for one use, and these are used more than once.
    x, y, z = (f"^v{name[1:]}" if name.startswith("^_") else name for name in variables)
    query = f"""
        pattern {pattern}({x} : {cls}, {y} : int) {{
            {cls}.{reference}({x}, {z});
            {cls}.{attribute}({z}, {y});
            check({y} >= 0 && {z}.{attribute} == {y});
            {x} != {z};
        }}
        pattern ^caller_of({x} : {cls}) {{ find {pattern}({x}, {y}); check({y} > 0); neg find {pattern}(_, 7); }}
        pattern ^closure_of({x} : {cls}, {y} : {cls}) {{ {cls}.{reference}+({x}, {y}); }}
    """
    metamodel = f"metamodel m class {cls} {{ int {attribute} refers {cls}[0..1] {reference} }}"
    engine = engine_of(metamodel, query)
    for name in ("caller_of", "closure_of"):
        engine.watch(name)
    [first, second] = [engine.model.create(names[0], **{names[2]: number}) for number in (1, 2)]
    [feature] = [one for one in engine.model.metamodel.references if one.name == names[1]]
    engine.model.graph.link(first.id, feature, second.id)
    for matcher in (engine.matcher, NaiveMatcher(engine.model, engine.library)):
        assert matcher.rows(names[3], (FREE, FREE)) == [(first.id, 2)]
        assert matcher.rows("caller_of", (FREE,)) == [(first.id,)]
        assert matcher.rows("closure_of", (FREE, FREE)) == [(first.id, second.id)]
