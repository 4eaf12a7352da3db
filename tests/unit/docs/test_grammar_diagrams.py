"""The diagrams and texts of the grammars show what the parsers accept."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest
from grammar_files import Choice, Part, Pattern, Reference, definition_of, parts_of, reachable_rules
from grammar_text import REFUSED, part_text, plain_name, rule_text, shown_definition, shown_rules

from envgraph.lang import LANGUAGES, TextFiles, load_workspace

FILES = ("common", "expressions", *LANGUAGES)
QUERY = "pattern p(x : Int, y : Int) { "


def alternatives(definition: Part) -> set[str]:
    """Return the texts of all alternatives in a definition."""
    return {part_text(one) for part in parts_of(definition) if isinstance(part, Choice) for one in part.parts}


def test_the_text_of_a_rule_is_its_ebnf() -> None:
    assert rule_text(Reference("query", "body")) == 'body: NAME? "{" constraint* "}"'
    assert rule_text(Reference("query", "modifier")).splitlines() == [
        'modifier: "private"',
        '        | "search"',
        '        | "incremental"',
    ]


def test_left_recursion_is_shown_as_a_loop() -> None:
    assert rule_text(Reference("expressions", "sum")) == 'sum: product (("+" | "-") product)*'
    assert rule_text(Reference("expressions", "conjunction")) == 'conjunction: equality ("&&" equality)*'


@pytest.mark.parametrize(("file", "name"), REFUSED)
def test_refused_alternatives_exist_in_the_grammar_and_are_not_shown(file: str, name: str) -> None:
    rule = Reference(file, name)
    assert alternatives(definition_of(rule)).issuperset(REFUSED[file, name])
    assert alternatives(shown_definition(rule)).isdisjoint(REFUSED[file, name])


@pytest.mark.parametrize(
    "file",
    [
        {"a.query": f"{QUERY}check(x > 1 or y > 1); }}"},
        {"a.query": f"{QUERY}check(x > 1 and y > 1); }}"},
        {"a.query": f"{QUERY}check(x = 1); }}"},
        {"a.query": f"{QUERY}check((x as Int) > 1); }}"},
        {"a.query": f"{QUERY}check(x instanceof Int); }}"},
        *({"a.query": f"{QUERY}x {sign} y; }}"} for sign in ("=", "<", "<=", ">", ">=")),
        {"a.query": f"{QUERY}x == y + 1; }}"},
        {"a.query": f"{QUERY}x == y.size; }}"},
        {"a.query": f"{QUERY}x == find p(x, y); }}"},
        {"a.query": f"{QUERY}x == eval unwind(y); }}"},
        {"a.rules": "rule r { lhs { a : A; b : B; a bs -> b; } rhs { } }"},
        {"a.rules": "rule r { lhs { a : A; b : B; a -> b; } rhs { } }"},
        {"a.rules": "rule r { lhs { a : A; } modify { set a.n == 3; } }"},
    ],
    ids=str,
)
def test_what_is_not_shown_is_refused(file: dict[str, str]) -> None:
    refusals = {"unexpected-token", "misplaced-expression", "misplaced-call", "cast", "eval-unwind"}
    refusals |= {"missing-token", "unnamed-arrow"}
    (root,) = file
    found = load_workspace((root,), files=TextFiles(file)).diagnostics
    assert refusals.intersection(one.code for one in found)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_rule_of_a_language_is_shown_on_some_page(language: str) -> None:
    shown = {rule for file in FILES for rule in shown_rules(file)}
    used = [rule for rule in reachable_rules(language) if rule.name != "start" and not rule.name.isupper()]
    assert len(used) > 10
    assert shown.issuperset(used)


@pytest.mark.parametrize("file", FILES)
def test_diagrams_fit_beside_the_contents_and_link_every_name(file: str) -> None:
    pytest.importorskip("railroad")
    pytest.importorskip("sphinx")
    from grammar_diagrams import Drawing, anchor

    for rule in shown_rules(file):
        if isinstance(definition_of(rule), Pattern):
            continue
        svg = Drawing(lambda other: f"{other}.html").svg(rule)
        root = ET.fromstring(svg)
        assert float(root.attrib["width"]) <= 700, rule
        assert root.attrib["aria-label"] == f"Diagram of {plain_name(rule.name)}"
        names = [part for part in parts_of(shown_definition(rule)) if isinstance(part, Reference)]
        links = {f"{name.file}.html#{anchor(name)}" for name in names if name in shown_rules(name.file)}
        assert links == set(re.findall(r'href="([^"]*)"', svg)), rule
