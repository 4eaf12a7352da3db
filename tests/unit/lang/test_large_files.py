"""Large files and long lists of mistakes: an answer in time that grows with the text, not with its square."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import pytest

from envgraph.errors import Diagnostic
from envgraph.lang import TextFiles, load_workspace

METAMODEL = "metamodel m class Node { int size refers Node[0..1] next }"
IMPORT = 'import "m.metamodel"\n'
COUNT = 1500
SECONDS = 20.0
"""Of processor time; each of the texts takes about one second, and a quadratic pass over it many."""


def patterns(make: Callable[[int], str], last: str = "") -> str:
    return IMPORT + "\n".join(map(make, range(COUNT))) + "\n" + last


def diagnostics_of(text: str, name: str = "q.query") -> tuple[Diagnostic, ...]:
    return load_workspace([name], files=TextFiles({"m.metamodel": METAMODEL, name: text})).diagnostics


LARGE = {
    "calls": (patterns(lambda n: f"pattern p{n}(x : Node) {{ find p{n + 1}(x); }}"), {"unknown-pattern": 1}),
    "unknown names": (
        patterns(lambda n: f"pattern p{n}(x : Nod{n}) {{ Nodes{n}(x); }}"),
        {"unknown-type": 2 * COUNT},
    ),
    "one mistake": (
        patterns(lambda n: f"pattern p{n}(x : Node) {{ Node(x); }}", "pattern q(x : Nod) { Node(x); }"),
        {"unknown-type": 1},
    ),
    "one name": (patterns(lambda n: "pattern p(x : Node) { Node(x); }"), {"duplicate-definition": COUNT - 1}),
    "parameters": (
        f"{IMPORT}pattern p({', '.join(f'x{n} : Node' for n in range(COUNT))}) {{ Node(x0); }}",
        {"unreferenced-parameter": COUNT - 1},
    ),
    "bodies": (IMPORT + "pattern p(x : Node) { Node(x); }" + " or { Node(x); }" * COUNT, {}),
    "a long body": (
        IMPORT + "pattern p(x0 : Node) {" + "".join(f"Node.next(x{n}, x{n + 1});" for n in range(COUNT)) + "}",
        {"body-too-long": 1},
    ),
    "a long path": (f"{IMPORT}pattern p(x : Node) {{ Node{'.next' * COUNT}(x, _); }}", {"body-too-long": 1}),
    "a long body without types": (
        IMPORT + "pattern p(x0) {" + "".join(f"Node.next(x{n}, x{n + 1});" for n in range(COUNT)) + "}",
        {"body-too-long": 1},
    ),
}


@pytest.mark.parametrize("name", LARGE)
def test_a_large_file_is_checked_soon(name: str) -> None:
    text, expected = LARGE[name]
    started = process_time()
    found = [one.code for one in diagnostics_of(text)]
    assert process_time() - started < SECONDS
    assert {code: found.count(code) for code in dict.fromkeys(found)} == expected


def test_inequalities_do_not_count_for_the_limit_of_body_size() -> None:
    names = [f"x{number}" for number in range(46)]
    pairs = [f"{one} != {other};" for one in names for other in names if one < other]
    text = f"{IMPORT}pattern p({', '.join(f'{name} : Node' for name in names)}) {{ {' '.join(pairs)} }}"
    assert len(pairs) > 1000
    assert [one.code for one in diagnostics_of(text)] == ["loose-connection"]


@pytest.mark.parametrize("mistake", ["$ ", '"open\n', "3x ", "0xg ", "\\ "])
def test_parsing_stops_after_a_hundred_syntax_errors(mistake: str) -> None:
    found = diagnostics_of(IMPORT + mistake * 100_000 + "\npattern p(x : Node) { find q(x); }")
    assert len(found) <= 202
    assert "too-many-errors" in [one.code for one in found]
    assert "unknown-pattern" not in [one.code for one in found]


def test_errors_in_one_string_are_limited_to_a_hundred() -> None:
    found = diagnostics_of(IMPORT + 'pattern p(x : Node) { check("' + "\\q" * 100_000 + '" == "a"); }')
    assert [one.code for one in found[:100]] == ["bad-escape"] * 100
    assert len(found) <= 102


def test_names_defined_after_parsing_stopped_are_not_reported_as_unknown() -> None:
    text = f"{IMPORT}pattern p(x : Node) {{ find q(x); }}\n" + "$ " * 200 + "\npattern q(x : Node) { Node(x); }"
    assert {one.code for one in diagnostics_of(text)} == {"stray-character", "too-many-errors"}


def test_hints_are_left_out_for_very_many_unknown_objects() -> None:
    objects = " ".join(f"a{n} : Node {{ next = b{n}; }}" for n in range(4 * COUNT))
    started = process_time()
    found = diagnostics_of(f"{IMPORT}model w : m {{ {objects} }}", "w.model")
    assert process_time() - started < SECONDS
    assert [one.code for one in found] == ["unknown-object"] * (4 * COUNT)
    assert found[-1].hint is None


def test_the_message_of_a_long_cycle_is_short() -> None:
    (problem,) = diagnostics_of(
        patterns(lambda n: f"pattern p{n}(x : Node) {{ Node(x); neg find p{(n + 1) % COUNT}(x); }}")
    )
    assert problem.code == "recursion-through-negation"
    assert f" -> ({COUNT - 20} more) -> neg p{COUNT - 9}" in problem.message
    assert problem.message.endswith("-> neg p0")
