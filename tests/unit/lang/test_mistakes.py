"""Mistakes that people make: each is reported where it stands, once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from envgraph.errors import Diagnostic
from envgraph.lang import Bundle, TextFiles, bundled_domain, load_workspace
from envgraph.search import Domain
from tests.reading import load_family

DOMAIN = bundled_domain("burning_forest")
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in sorted(DOMAIN.glob("*.*"))}
TEXTS["family.toml"] = TEXTS.pop("paper.toml")
METAMODEL = "metamodel m class A { int i refers A[1] next contains A[0..*] parts }"


def diagnostics_of(root: str, **changed: str) -> list[Diagnostic]:
    """What is said about a file, with other texts beside it; `_` in a name stands for `.`."""
    texts = {name.replace("_", "."): text for name, text in changed.items()}
    return list(load_workspace([root], files=TextFiles(texts)).diagnostics)


def diagnostics_after_change(name: str, old: str, new: str) -> list[Diagnostic]:
    """What is said about the bundled family with one stretch of one file replaced."""
    assert old in TEXTS[name]
    texts = TEXTS | {name: TEXTS[name].replace(old, new, 1)}
    return list(load_workspace(["family.toml"], files=TextFiles(texts)).diagnostics)


def file_and_text(one: Diagnostic) -> tuple[str, str]:
    assert one.span is not None
    return one.span.source.name, one.span.text


# --- directories


@pytest.fixture
def forest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    directory = tmp_path / "forest"
    shutil.copytree(DOMAIN, directory)
    (directory / "paper.toml").replace(directory / "family.toml")
    monkeypatch.chdir(directory)
    return directory


@pytest.mark.parametrize("path", [".", "../forest", "./", "family.toml"])
def test_the_working_directory_is_read_once(forest: Path, path: str) -> None:
    workspace = load_workspace([path])
    assert workspace.diagnostics == ()
    assert all("/" not in name for name in workspace.sources)


def test_a_family_without_a_name_is_called_after_its_directory(forest: Path) -> None:
    text = (forest / "family.toml").read_text().replace('name = "BurningForest"', "")
    (forest / "family.toml").write_text(text)
    assert load_family(".").name == load_family("family.toml").name == "forest"


# --- conformance


def test_a_model_that_does_not_conform_is_warned_about() -> None:
    (found,) = diagnostics_of(
        "a.model", a_model='import "m.metamodel" model a : m { a : A { } }', m_metamodel=METAMODEL
    )
    assert (found.code, str(found.severity), file_and_text(found)) == (
        "conformance",
        "warning",
        ("a.model", "a"),
    )
    assert "`next`, which needs 1" in found.message


def test_a_nonconforming_model_of_a_family_is_an_error() -> None:
    (found,) = diagnostics_after_change("target_8x8.model", "FireTruck { currentState = tile[0, 0] }", "FireTruck { }")
    assert (found.code, str(found.severity), file_and_text(found)) == (
        "conformance",
        "error",
        ("target_8x8.model", "truck"),
    )


def test_conformance_is_not_checked_if_the_metamodel_has_errors() -> None:
    found = diagnostics_of(
        "a.model",
        a_model='import "m.metamodel" model a : m { a : A { } }',
        m_metamodel="metamodel m class A { refers B[1] next }",
    )
    assert [one.code for one in found] == ["unknown-class"]


# --- names


def test_an_ambiguous_pattern_of_a_family_gets_a_hint_with_all_candidates() -> None:
    texts = TEXTS | {
        "other.query": 'package other import "burning_forest.metamodel" pattern solvable(t : Tile) { Tile(t); }',
        "family.toml": 'imports = ["other.query"]\n' + TEXTS["family.toml"],
    }
    (found,) = load_workspace(["family.toml"], files=TextFiles(texts)).diagnostics
    assert found.code == "ambiguous-pattern"
    assert found.hint == "write one of `other.solvable`, `burning_forest.solvable`"


def test_a_duplicate_definition_is_not_also_reported_as_ambiguous() -> None:
    twice = "pattern collectedWater(water : WaterTile) { WaterTile(water); }\n"
    found = diagnostics_after_change(
        "burning_forest.query", "/** The truck waits", twice + twice + "/** The truck waits"
    )
    assert {one.code for one in found} == {"duplicate-definition"}
    found = diagnostics_after_change("family.toml", '"solvable"', '"collectedWater"')
    assert found == []


def test_a_pattern_without_a_package_does_not_make_a_name_ambiguous() -> None:
    texts = TEXTS | {
        "other.query": 'import "burning_forest.metamodel" pattern solvable(t : Tile) { Tile(t); }',
        "family.toml": 'imports = ["other.query"]\n' + TEXTS["family.toml"],
    }
    assert load_workspace(["family.toml"], files=TextFiles(texts)).diagnostics == ()


def test_a_private_pattern_with_a_constraint_annotation_is_not_unused() -> None:
    private = "private pattern alone(t : Tile) { neg find neighbour(t, _); }\n"
    annotated = '@Constraint(key = t, severity = "error", message = "alone")\n' + private
    mark = "/** The goal can be reached"
    assert [one.code for one in diagnostics_after_change("burning_forest.query", mark, private + mark)] == [
        "unused-private-pattern"
    ]
    assert diagnostics_after_change("burning_forest.query", mark, annotated + mark) == []


# --- words


def test_messages_use_the_right_article_for_types() -> None:
    (found,) = diagnostics_after_change(
        "burning_forest.environment", "observe find collectedWater(_)", "observe truck.currentState"
    )
    assert found.message.startswith("a `State`")
    (found,) = diagnostics_after_change(
        "burning_forest.query", "Tile.y(tile, 5);", "Tile.y(tile, 5); Tile.y(tile, t); Tile(t);"
    )
    assert "both an `int` and a `Tile`" in found.message


# --- one mistake, one diagnostic


@pytest.mark.parametrize(
    ("name", "old", "new", "word"),
    [
        ("burning_forest.metamodel", "extends Environment", "extends Environmnt", "Environmnt"),
        ("burning_forest.metamodel", "@key(y, x)", "@key(y, z)", "z"),
        ("target_8x8.model", "SVVVRVRV", "SVVVRVR", "SVVVRVR"),
        ("burning_forest.query", "(y == 0));", "(z == 0));", "z"),
        ("burning_forest.query", "check((x == 0)", "check((nope(x) == 0)", "nope"),
        (
            "burning_forest.query",
            "find passage+(start, goal)",
            "find passage+(start)",
            "find passage+(start)",
        ),
        ("burning_forest.query", "before the first step. */", "before the first step.", "/*"),
        ("burning_forest.query", "(water, true);\n}", "(water, true);", ""),
        ("burning_forest.query", "check((x == 0)", "check(" + 3000 * "(" + "x == 0" + 3000 * ")", "("),
    ],
)
def test_consequences_of_an_error_are_not_reported(name: str, old: str, new: str, word: str) -> None:
    (found,) = diagnostics_after_change(name, old, new)
    assert file_and_text(found) == (name, word)


# --- families


@pytest.mark.parametrize(
    ("old", "new", "word", "hint"),
    [
        ('name = "BurningForest"', 'name = "../forest"', '"../forest"', "remove `/`"),
        ('name = "BurningForest"', "name = Forest", "Forest", 'write `"Forest"` for a string'),
        ("keep_initial = true", "keep_initial = True", "True", "write `true`"),
        ("seed = 42", "seed = 42\nseed = 43", "seed", None),
        ("[search]", "[mutation]", "[mutation]", None),
        ("[measures.complexity]", "[measures]", "[measures]", "write `[measures.complexity]`"),
        ('"target_8x8.model"', '"burning_forest.query"', '"burning_forest.query"', "`.model` file"),
        (
            '"burning_forest.environment"',
            '"burning_forest.rules"',
            '"burning_forest.rules"',
            "`.environment`",
        ),
    ],
)
def test_errors_in_a_family_file_are_reported_at_their_position(
    old: str, new: str, word: str, hint: str | None
) -> None:
    found = [one for one in diagnostics_after_change("family.toml", old, new) if not one.code.startswith("unknown-")]
    assert [file_and_text(one) for one in found] == [("family.toml", word)]
    assert (hint or "") in (found[0].hint or "")


def test_a_family_uses_the_model_and_environment_that_its_file_sets() -> None:
    import_both = 'imports = ["running_4x4.model", "other.environment"]\n'
    other = TEXTS["burning_forest.environment"].replace("environment BurningForest", "environment Other")
    texts = TEXTS | {"family.toml": import_both + TEXTS["family.toml"], "other.environment": other}
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    assert len(domain.initial().nodes("Tile")) == 64
    assert domain.behaviour is not None and domain.behaviour.name == "BurningForest"
    twice = TEXTS["burning_forest.environment"] + other.partition('rules"\n')[2]
    (found,) = diagnostics_after_change("burning_forest.environment", TEXTS["burning_forest.environment"], twice)
    assert (found.code, file_and_text(found)) == (
        "no-single-environment",
        ("family.toml", '"burning_forest.environment"'),
    )


def test_a_second_metamodel_is_one_error() -> None:
    found = diagnostics_of(
        "a.query",
        a_query='import "m.metamodel" import "n.metamodel" pattern p(b : B) { B(b); }',
        m_metamodel="metamodel m class A",
        n_metamodel="metamodel n class B",
    )
    assert [one.code for one in found] == ["two-metamodels"]


def test_a_rule_name_that_two_packages_define_is_ambiguous() -> None:
    texts = {
        "m.metamodel": METAMODEL,
        "one.rules": 'package one import "m.metamodel" rule go { lhs { a : A; } modify { set a.i = 1; } }',
        "two.rules": 'package two import "m.metamodel" rule go { lhs { a : A; } modify { set a.i = 2; } }',
        "e.environment": 'import "one.rules" import "two.rules" environment E { action go = go() }',
    }
    found = load_workspace(["e.environment"], files=TextFiles(texts)).errors
    assert [(one.code, file_and_text(one), one.hint) for one in found] == [
        ("ambiguous-rule", ("e.environment", "go"), "write `one.go` or `two.go`")
    ]
    texts["e.environment"] = texts["e.environment"].replace("= go()", "= one.go()")
    assert load_workspace(["e.environment"], files=TextFiles(texts)).errors == ()


def test_wrong_values_and_unknown_names_of_a_family_file_are_reported_together() -> None:
    text = TEXTS["family.toml"].replace("seed = 42", "seed = -1").replace('"solvable"', '"solvble"')
    text = text.replace("population = 6", 'population = "six"').replace('avoid = "BurningTile"', 'avoid = "Burning"')
    found = list(load_workspace(["family.toml"], files=TextFiles(TEXTS | {"family.toml": text})).diagnostics)
    assert [file_and_text(one)[1] for one in found] == ["-1", '"solvble"', '"Burning"', '"six"']


def test_names_are_not_resolved_if_the_family_has_no_valid_file_paths() -> None:
    for old, new in (
        ('model = "', 'modle = "'),
        ('environment = "', 'enviroment = "'),
        ('"target_8x8.model"', "3"),
    ):
        (one,) = diagnostics_after_change("family.toml", old, new)[:1]
        assert len([d for d in diagnostics_after_change("family.toml", old, new) if d.code.startswith("unknown-")]) <= 1
        assert one.span is not None


def test_definitions_in_the_wrong_kind_of_file_are_reported_once() -> None:
    pattern, rule = "pattern p(x : A) { A(x); }", "rule r { lhs { a : A; } modify { set a.i = 1; } }"
    for root, text, word, home in (
        ("x.rules", f"{pattern} {rule}", "pattern", "query"),
        ("x.query", f"{pattern} {rule}", "rule", "rules"),
        ("x.query", f"{pattern} unit u {{ r; }}", "unit", "rules"),
    ):
        files = {root.replace(".", "_"): f'package b import "m.metamodel" {text}', "m_metamodel": METAMODEL}
        (one,) = diagnostics_of(root, **files)
        assert file_and_text(one) == (root, word)
        assert one.hint == f"write a `{word}` in a `.{home}` file, which other files can import"
