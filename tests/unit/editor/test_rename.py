"""A rename changes all places of a name and no others, or is refused."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from envgraph.editor import find_problems
from envgraph.errors import InvalidArgument
from envgraph.lang import TextFiles, bundled_domains, load_workspace
from tests.editing import MEMORY, Editor, apply_edits, domain_texts
from tests.profile import AT_NIGHT
from tests.unit.editor.test_navigation import TEXTS

DEFINING = {"class", "feature", "literal", "pattern", "rule", "function", "measure", "action", "model", "environment"}


def rename(editor: Editor, uri: str, at: str | int, new: str) -> list[str]:
    """Rename what is at a position, and return the URIs of the changed files."""
    changes: dict[str, Any] = editor.ask("rename", uri, at, newName=new)["changes"]
    for changed, edits in changes.items():
        text = apply_edits(editor.service.documents[changed].source.text, edits)
        editor.change(changed, {"text": text})
    return [*changes]


def problems(texts: dict[str, str], domain: str) -> list[str]:
    """Return the codes of the problems of a domain, of its audit and of its other family files."""
    files = TextFiles(texts)
    others = [name for name in texts if name.endswith(".toml") and name != f"{domain}/family.toml"]
    roots = [domain, *dict.fromkeys(name.rpartition("/")[0] for name in texts if name.count("/") > 1), *others]
    return [one.code for root in roots for one in find_problems(load_workspace([root], files=files))]


def rename_at_random(domain: str, number: int, seed: int = 0) -> None:
    """Rename definitions and variables one after the other; the checks must find the same as before."""
    texts, random = domain_texts(domain), Random(seed)
    editor = Editor(texts)
    editor.open_all()
    expected = problems(texts, domain)
    done = 0
    for _ in range(number):
        name = random.choice([one for one in texts if not one.endswith(".md")])
        document = editor.service.documents[MEMORY + name]
        index = editor.service.index(name)
        known = [
            start + one.start
            for start, names in index.parts(document.source)
            for one in names.all
            if one.kind in {*DEFINING, "variable", "object"} and not one.text.startswith("zz")
        ]
        known = [one for one in known if (place := index.place_at(document.source, one)) and index.resolve(place)]
        if known:
            rename(editor, MEMORY + name, random.choice(known), f"zz{done}")
            done += 1
    changed = {uri.removeprefix(MEMORY): one.source.text for uri, one in editor.service.documents.items()}
    assert done and changed != texts
    assert problems(changed, domain) == expected


def test_a_domain_has_the_same_problems_after_renames() -> None:
    rename_at_random("railway", 5)


@AT_NIGHT
@pytest.mark.parametrize("domain", bundled_domains())
def test_every_domain_has_the_same_problems_after_many_renames(domain: str) -> None:
    for seed in range(3):
        rename_at_random(domain, 60, seed)


def test_a_feature_is_renamed_where_its_class_is_inferred() -> None:
    editor = Editor(TEXTS)
    editor.open_all()
    assert len(rename(editor, MEMORY + "shop.rules", "below.|size", "extent")) == 4
    assert editor.codes(MEMORY + "shop.rules") == []
    assert "check box.below.extent" in editor.service.documents[MEMORY + "shop.rules"].source.text


@pytest.mark.parametrize(
    ("file", "at", "new", "message"),
    [
        ("shop.query", "pattern |covered", "upper", "the pattern at shop.query:8:9 is already called `upper`"),
        ("shop.query", "pattern |covered", "shrink", "the rule or unit at shop.rules:4:6 is already called `shrink`"),
        ("shop.query", "pattern |covered", "2x", "`2x` is not a name"),
        ("shop.query", "pattern |covered", "find", "`find` has a meaning in "),
        ("shop.query", "pattern |covered", "derive", "`derive` has a meaning in more.rules"),
        ("shop.metamodel", "class |Box", "Size", "the class or enum at shop.metamodel:2:6 is already called `Size`"),
        ("shop.metamodel", "class |Box", "int", "`int` has a meaning in"),
        ("shop.metamodel", "Size |size", "above", "the feature at shop.metamodel:6:22 is already called `above`"),
        ("shop.query", "covered(|box : Box, on)", "on", "the variable at shop.query:5:28 is already called `on`"),
        ("shop.model", "|low : Box", "high", "the object at shop.model:3:25 is already called `high`"),
        ("shop.query", 'import "|shop', "other", "there is no name here that can be changed"),
    ],
)
def test_names_that_would_change_a_meaning_are_refused(file: str, at: str, new: str, message: str) -> None:
    texts = TEXTS | {"more.rules": 'import "shop.query"\nrule any() { lhs { find covered(_, _); } }\n'}
    editor = Editor(texts)
    editor.open_all()
    with pytest.raises(InvalidArgument) as caught:
        rename(editor, MEMORY + file, at, new)
    assert str(caught.value).startswith(message)


def test_a_rename_waits_until_mistakes_beside_the_name_are_corrected() -> None:
    editor = Editor(TEXTS)
    editor.open_all()
    editor.change(MEMORY + "shop.rules", {"text": TEXTS["shop.rules"].replace("find upper(box);", "find upper(box;")})
    with pytest.raises(InvalidArgument, match=r"there are mistakes near `upper` at shop.rules:5:27"):
        rename(editor, MEMORY + "shop.query", "pattern |upper", "higher")


def test_a_name_in_a_file_of_another_format_is_not_changed() -> None:
    editor = Editor(TEXTS | {"b.xmi": '<shop:Box xmlns:shop="shop" xmlns:xmi="http://www.omg.org/XMI"/>'})
    editor.open_all()
    with pytest.raises(InvalidArgument, match=r"b.xmi contains `Box`, too, but cannot be changed"):
        rename(editor, MEMORY + "shop.metamodel", "class |Box", "Crate")
