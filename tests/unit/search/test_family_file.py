"""Family files that somebody has edited."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest

from envgraph.errors import EnvgraphError, LoadError
from envgraph.search import Outcome, family_schema, generate, read_family, write_family


@pytest.fixture(scope="module")
def text(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A family file with two members."""
    path = tmp_path_factory.mktemp("runs") / "run.sqlite"
    return write_family(generate("burning_forest/paper.toml", path, generations=2, population=2))


def edited(text: str, *path: str | int, value: Any) -> str:
    """The file with another value at a place."""
    document = json.loads(text)
    place = document
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return json.dumps(document, indent=1)


def problems(tmp_path: Path, text: str) -> list[tuple[str, str]]:
    """What is wrong with a file: the text that is pointed at, and the message."""
    file = tmp_path / "family.json"
    file.write_text(text)
    with pytest.raises(LoadError) as caught:
        read_family(file)
    found = caught.value.diagnostics
    assert all(one.span is not None and one.span.source.name == str(file) for one in found)
    return [(one.span.text, one.message) for one in found if one.span]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("name",), 3, "`name` is a number, not a string"),
        (("roots",), [], "`roots` is empty"),
        (("roots", 0), None, "`roots[0]` is null, not a string"),
        (("texts",), [], "`texts` is a list, not an object"),
        (("overrides",), {}, "`overrides` is an object, not a list"),
        (("members",), [], "`members` is empty"),
        (("members", 1, "initial"), "yes", "`members[1].initial` is a string, not a truth value"),
        (("members", 1, "measures", "complexity"), "x", "`members[1].measures.complexity` is a string, not a number"),
        (("members", 0, "measures"), {}, "`E1` has no measure `complexity`"),
        (("members", 1, "name"), "E1", "there are two members `E1`"),
        (("keys",), {}, "`keys` does not contain the keys of all members' objects"),
    ],
    ids=str,
)  # fmt: skip
def test_value_of_the_wrong_type_is_reported_with_its_position(
    tmp_path: Path, text: str, path: tuple[str | int, ...], value: Any, message: str
) -> None:
    assert problems(tmp_path, edited(text, *path, value=value)) == [(json.dumps(value), message)]


def test_mistake_in_an_embedded_model_is_reported_with_its_position(tmp_path: Path, text: str) -> None:
    path = ("members", 1, "model", "objects", 3, "class")
    (found, message), *_ = problems(tmp_path, edited(text, *path, value="RoadTyle"))
    assert found == '"RoadTyle"' and "objects[3].class" in message


def test_all_mistakes_of_a_family_file_are_reported_together(tmp_path: Path, text: str) -> None:
    broken = edited(edited(text, "name", value=3), "members", 0, "initial", value=3)
    assert [message for _, message in problems(tmp_path, broken)] == [
        "`name` is a number, not a string",
        "`members[0].initial` is a number, not a truth value",
    ]


def test_missing_and_unexpected_keys_are_reported(tmp_path: Path, text: str) -> None:
    document = json.loads(text)
    del document["roots"]
    document["root"] = []
    messages = [message for _, message in problems(tmp_path, json.dumps(document))]
    assert messages == ["the document has no `roots`", "unknown key `root`"]


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999"])
def test_invalid_json_numbers_are_reported_with_their_position(tmp_path: Path, text: str, number: str) -> None:
    broken = edited(text, "members", 0, "measures", "complexity", value="@").replace('"@"', number)
    assert problems(tmp_path, broken) == [(number, f"`{number}` is not a JSON number")]


def test_mistakes_in_embedded_texts_name_the_family_file(tmp_path: Path, text: str) -> None:
    document = json.loads(text)
    root = document["roots"][0]
    file = tmp_path / "family.json"
    file.write_text(edited(text, "texts", root, value=document["texts"][root].replace("rate = 0.85", "rate = 2")))
    with pytest.raises(LoadError, match="`rate` is 2, but must be from 0 to 1") as caught:
        read_family(file)
    assert f"note: the text is in {file}" in str(caught.value)


def test_root_that_is_not_a_family_file_is_reported(tmp_path: Path, text: str) -> None:
    query = next(name for name in json.loads(text)["texts"] if name.endswith(".query"))
    file = tmp_path / "family.json"
    file.write_text(edited(text, "roots", value=[query]))
    with pytest.raises(LoadError, match=f"`{query}` is not a family file"):
        read_family(file)


def test_mistakes_in_stored_overrides_are_reported(tmp_path: Path, text: str) -> None:
    file = tmp_path / "family.json"
    file.write_text(edited(text, "overrides", value=["seed=x"]))
    with pytest.raises(LoadError, match="--set:1:6: `seed` must be a whole number, not a string"):
        read_family(file)


def test_written_family_file_conforms_to_its_json_schema(text: str) -> None:
    from jsonschema import Draft202012Validator

    Draft202012Validator.check_schema(family_schema())
    Draft202012Validator(family_schema()).validate(json.loads(text))


WRONG = [None, 0, -1, 10**30, 1.5, True, "", "x", "E1", [], {}, [1], {"a": 1}, "RoadTile"]


def test_edited_family_file_is_read_or_refused_with_its_name(tmp_path: Path, text: str) -> None:
    rng = random.Random(5)
    document = json.loads(text)
    places = [path for path in paths(document) if len(path) <= 4]
    for turn in range(25):
        broken = edited(text, *rng.choice(places), value=rng.choice(WRONG))
        file = tmp_path / f"{turn}.json"
        file.write_text(broken)
        try:
            Outcome.of(read_family(file))
        except EnvgraphError as error:
            assert file.name in str(error), broken


def paths(value: Any, at: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Of all parts of a JSON value."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path for key, part in entries for path in ((*at, key), *paths(part, (*at, key)))]
