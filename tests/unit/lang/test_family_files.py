"""`family.toml`: what it means. What is said about mistakes: tests/golden/family."""

import re
import shutil
from dataclasses import fields
from inspect import getdoc
from pathlib import Path

import pytest

from envgraph.errors import LoadError
from envgraph.lang import FamilySpec, TextFiles, bundled_domain, check_family, load_workspace
from tests.reading import load_family, read_toml

MINIMAL = 'model = "a.model"\n[measures.size]\nkind = "count"\nof = "any"\n[mutation]\nrules = ["grow"]\n'


def family(text: str) -> FamilySpec:
    return load_family("dir/family.toml", TextFiles({"dir/family.toml": text}))


def errors(text: str) -> list[str]:
    with pytest.raises(LoadError) as caught:
        family(text)
    return [f"{one.span.line}:{one.span.column} {one.message}" for one in caught.value.diagnostics if one.span]


TABLES = ("constraints", "mutation", "search", "samples", "optimise", "curriculum", "training")
FAMILY_OF_EVERYTHING = family(
    MINIMAL.replace("[", '[samples]\ncover = { size = 2 }\n[optimise]\nmaximise = ["size"]\n[', 1)
)
"""A family file from which no table is missing."""


def test_the_documentation_shows_every_key_of_family_files() -> None:
    """The site takes the tables of keys from these docstrings."""
    pages = [Path(__file__).parents[3] / "docs/languages" / name for name in ("family.md", "problem.md")]
    shown = set(re.findall(r"^```\{family-table\} (.*)$", "".join(page.read_text() for page in pages), re.MULTILINE))
    specs = {table: getattr(FAMILY_OF_EVERYTHING, table) for table in TABLES}
    specs["training.epsilon"] = FAMILY_OF_EVERYTHING.training.epsilon
    assert shown == {*specs, "top", "audit"}
    for spec in specs.values():
        described = re.findall(r"^    (\w[\w, ]*): \w", getdoc(spec) or "", re.MULTILINE)
        assert {one.name for one in fields(spec)} == {name for names in described for name in names.split(", ")}


def test_the_bundled_family_has_the_settings_of_the_paper() -> None:
    spec = load_family("burning_forest/paper.toml")
    assert (spec.name, spec.seed) == ("BurningForest", 42)
    assert [str(name) for name in spec.constraints.require][-2:] == ["solvable", "truckOnStart"]
    assert spec.measures[0].kind == "path_complexity"
    assert spec.measures[0].options["along"] == ["right", "down"]
    assert spec.diversity.options == {"of": "complexity"}
    assert spec.mutation.initial_applications == (1, 5)
    assert (spec.search.population, spec.search.generations, spec.search.keep_initial) == (6, 1000, True)
    assert spec.search.survivors.options == {"rounds": 500, "initial_temperature": 0.1, "cooling_rate": 0.95}
    assert spec.training.epsilon.per == "episode"
    assert (spec.training.steps_per_environment, spec.training.seeds) == (50_000, 30)
    assert str(spec.curriculum.order) == "complexity"
    assert Path(str(spec.model)).name == "target_8x8.model"


def test_missing_keys_have_the_published_defaults() -> None:
    spec = family(MINIMAL)
    assert spec.name == "dir"
    assert (spec.seed, spec.limit, spec.environment) == (0, None, None)
    assert (spec.mutation.rate, spec.mutation.max_attempts) == (0.85, 50)
    assert spec.mutation.strength == "single"
    assert (spec.search.parents.kind, spec.search.survivors.kind) == ("random", "simulated_annealing")
    assert (spec.training.learning_rate, spec.training.discount, spec.training.epsilon.decay) == (
        0.1,
        0.99,
        0.995,
    )
    assert (spec.diversity.kind, spec.diversity.options["of"]) == ("binned_entropy", "size")


def test_paths_are_relative_to_the_file() -> None:
    spec = family('environment = "../b/c.environment"\nimports = ["x.query"]\n' + MINIMAL)
    assert spec.files == ("dir/a.model", "dir/x.query", "b/c.environment")


@pytest.mark.parametrize(
    ("written", "bounds"),
    [
        ('"1..5"', (1, 5)),
        ('"2..*"', (2, None)),
        ('"3"', (3, 3)),
        ("3", (3, 3)),
        ("[0, 4]", (0, 4)),
        ('" 1 .. 2 "', (1, 2)),
    ],
)
def test_bounds_of_counts_can_be_written_in_several_ways(written: str, bounds: tuple[int, int | None]) -> None:
    spec = family(MINIMAL + f"[constraints]\ncount = {{ any = {written} }}\n")
    assert [(str(name), found) for name, found in spec.constraints.count] == [("any", bounds)]


@pytest.mark.parametrize("written", ['"1-5"', "-1", "1.5", '"5..1"', "[1]", "true", '"..3"', '"99999999999..3"'])
def test_invalid_bounds_of_counts_are_refused_at_their_position(written: str) -> None:
    (error,) = errors(MINIMAL + f"[constraints]\ncount = {{ any = {written} }}\n")
    assert error.startswith("8:17 ")


@pytest.mark.parametrize(
    "name",
    ['parents = "tournament"', 'parents = { name = "tournament" }', '[search.parents]\nname = "tournament"'],
)
def test_components_of_the_search_can_be_named_or_described(name: str) -> None:
    spec = family(MINIMAL + f"[search]\n{name}\n")
    assert (spec.search.parents.kind, spec.search.parents.options) == ("tournament", {})


def test_a_search_without_generations_needs_another_limit() -> None:
    assert family(MINIMAL + "[search]\ngenerations = false\ntime_limit = 60\n").search.generations is None
    assert errors(MINIMAL + "[search]\ngenerations = false\n") == ["8:15 the search has no limit"]


def test_values_of_components_have_positions() -> None:
    measure = family(MINIMAL).measures[0]
    assert [str(measure.span(option)) for option in ("", "kind", "of", "other")] == [
        "dir/family.toml:2:1",
        "dir/family.toml:3:8",
        "dir/family.toml:4:6",
        "dir/family.toml:2:1",
    ]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("x = ", "1:5 invalid value"),
        ("x = 1\nx = 2", "2:1 `x` is defined twice"),
        ("[a]\n[a]", "2:1 `[a]` is defined twice"),
        ("x = 'a", '1:7 expected "\'"'),
        ("x = [1, 2", "1:10 unclosed array"),
        ("x = 1\r\ny = = 1\r\n", "2:5 invalid value"),
        ("x = " + "[" * 5000, "1:1 this line has more than 50 opening brackets"),
        (".".join("a" * 20_000) + " = 1", "1:1 a key has more than 50 parts"),
        ('x = 1\n[a."b c' + '".a."' * 60 + '"]', "2:2 a key has more than 50 parts"),
        ("y = 1\nx = " + "9" * 5000, "2:5 the number is too large"),
        ("y = 1\nx = [1, 9_223_372_036_854_775_808]", "2:9 the number is too large"),
        ("x = 0x" + "f" * 5000, "1:5 the number is too large"),
    ],
)
def test_invalid_toml_is_refused_with_a_position(text: str, error: str) -> None:
    (found,) = errors(text)
    assert found.lower().startswith(error.lower())


def test_every_value_of_a_toml_text_has_its_span() -> None:
    text = read_toml(
        '''
a.b = 1 # c = 2
"q.r" = 'x # y'
long = """
[no.table] " ""
"""
list = [ # one
  1, [2, "]"], # two
  { x = 3 },
]
[t . u]
date = 1979-05-27 07:32:00
[[rows]]
n = 1
[rows.in]
m = "a\\"b"
[[rows]]
n = { deep.er = true, last = '' }
'''
    )
    found = {path: span.text for path, span in text.values.items()}
    assert found["a", "b"] == "1"
    assert found["q.r",] == "'x # y'"
    assert found["long",].startswith('"""\n[no')
    assert found["list", 1, 1] == '"]"'
    assert found["list", 2, "x"] == "3"
    assert found["t", "u", "date"] == "1979-05-27 07:32:00"
    assert found["rows", 0, "n"] == "1"
    assert found["rows", 0, "in", "m"] == '"a\\"b"'
    assert found["rows", 1, "n", "deep", "er"] == "true"
    assert found["rows", 1, "n", "last"] == "''"
    assert text.key_span("rows", 1, "n", "deep", "er").text == "er"
    assert text.value_span("t", "nothing").text == "[t . u]"


def test_the_path_of_a_directory_loads_its_family_file(tmp_path: Path) -> None:
    shutil.copytree(bundled_domain("burning_forest"), tmp_path / "mine")
    assert load_family(str(tmp_path / "mine")).name == "BurningForestTeaching"
    assert load_family(str(tmp_path / "mine" / "family.toml")) == load_family(str(tmp_path / "mine"))


def test_a_local_directory_is_preferred_to_a_bundled_domain_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "burning_forest").mkdir()
    (tmp_path / "burning_forest" / "family.toml").write_text(MINIMAL)
    monkeypatch.chdir(tmp_path)
    assert load_family("burning_forest").name == "burning_forest"


def test_a_missing_family_file_is_reported_as_missing(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="there is no such file"):
        load_family(str(tmp_path))
    with pytest.raises(LoadError, match="there is no such file"):
        load_family(str(tmp_path / "family.toml"))


def test_a_bundled_domain_without_a_family_file_gets_its_own_error() -> None:
    with pytest.raises(LoadError, match=r"the bundled domain `social_media` has no `family\.toml`") as caught:
        load_family("social_media")
    hint = caught.value.diagnostics[0].hint
    assert hint is not None
    assert "`burning_forest`" in hint
    assert "social_media" not in hint


def test_check_family_knows_only_the_components_that_are_passed() -> None:
    spec = load_family("burning_forest/paper.toml")
    workspace = load_workspace(spec.files)
    assert check_family(spec, workspace) == []
    mine = {"measure": ("mine",), "diversity": (), "parents": (), "survivors": ()}
    assert [one.code for one in check_family(spec, workspace, mine)] == ["unknown-component"] * 4


def test_numbers_above_their_limit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "model = 'a.model'\n[search]\npopulation = 1000000000000\n[training]\nseeds = 100001\n"
    with pytest.raises(LoadError) as caught:
        load_family("f.toml", TextFiles({"f.toml": text}))
    found = [one for one in caught.value.diagnostics if one.code == "bad-range"]
    assert [f"{one.span} {one.message}" for one in found] == [
        "f.toml:3:14 `population` is 1000000000000, but must be at most 100,000",
        "f.toml:5:9 `seeds` is 100001, but must be at most 100,000",
    ]
    assert {one.hint for one in found} == {
        "set the environment variable ENVGRAPH_LIMITS=10 to make every limit ten times as large"
    }
    monkeypatch.setenv("ENVGRAPH_LIMITS", "2")
    with pytest.raises(LoadError) as caught:
        load_family("f.toml", TextFiles({"f.toml": text}))
    assert [one.span.line for one in caught.value.diagnostics if one.code == "bad-range" and one.span] == [3]
