"""A check that reuses an earlier one finds the same problems as a check of all files from the beginning."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from random import Random

import pytest

from envgraph.editor._checked_files import CheckJob
from envgraph.errors import Diagnostic
from envgraph.lang import TextFiles, bundled_domains, data_path
from envgraph.pattern.check import _patterns
from tests.editing import domain_texts
from tests.profile import NIGHTLY

SIGNS = [";", "}", "neg ", "private ", "/* */", "1.0", "true", '@suppress("unused-import") ']


def edited_texts(texts: dict[str, str], random: Random, count: int) -> Iterator[dict[str, str]]:
    """Yield the texts of a domain, each time with one word of one file replaced; every other time, edits are undone."""
    now = dict(texts)
    for number in range(count):
        name = random.choice([*texts])
        words = [*re.finditer(r"\w+", texts[name])]
        if number % 2:
            now = texts | {name: now[name]}
        elif words:
            word, other = random.choice(words), random.choice([random.choice(words).group()] * 8 + SIGNS)
            now[name] = texts[name][: word.start()] + other + texts[name][word.end() :]
        yield dict(now)


def described(problems: Sequence[Diagnostic]) -> list[tuple[object, ...]]:
    """Return problems as data that can be compared between two readings of a text."""
    return [
        (one.code, one.severity, one.message, one.hint, place(one), [(note.message, place(note)) for note in one.notes])
        for one in problems
    ]


def place(one: object) -> tuple[object, ...] | None:
    span = getattr(one, "span", None)
    return span and (span.source.name, span.start, span.end, span.text)


def test_only_patterns_that_depend_on_an_edit_are_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[str] = []

    class Check(_patterns._PatternCheck):
        def problems(self, header: Sequence[Diagnostic]) -> list[Diagnostic]:
            looked_at.append(self._pattern.name)
            return super().problems(header)

    monkeypatch.setattr(_patterns, "_PatternCheck", Check)
    text = 'import "sokoban.metamodel"\n'
    text += "".join(
        f"pattern p{one}(a : Floor, b : Floor) {{ Cell.west(a, b); find p{one + 1}(a, b); }}\n" for one in range(4)
    )
    text += "pattern p4(a : Floor, b) { Cell.south(a, b); }\n"
    texts = {"sokoban.metamodel": data_path("rules", "sokoban", "sokoban.metamodel").read_text("utf-8")}
    last = CheckJob((".",), TextFiles(texts | {"a.query": text})).run()
    found = []
    for old, new in [
        ("p4(a : Floor, b)", "p4(a : Floor, b : Cell)"),
        ("pattern p2", "\npattern p2"),
        ("find p2", "find p3"),
    ]:
        looked_at.clear()
        text = text.replace(old, new, 1)
        last = CheckJob((".",), TextFiles(texts | {"a.query": text}), last=last).run()
        found.append([*looked_at])
    assert found == [["p3", "p4"], [], ["p0", "p1"]]
    assert not last.problems


@pytest.mark.parametrize("domain", bundled_domains() if NIGHTLY else ["assignment", "railway"])
def test_edits_give_the_problems_of_a_check_from_the_beginning(domain: str) -> None:
    last, found = None, set[str]()
    for texts in edited_texts(domain_texts(domain), Random(domain), 200 if NIGHTLY else 12):
        files = TextFiles(texts)
        fresh = CheckJob((domain,), files).run()
        last = CheckJob((domain,), files, last=last).run()
        assert described(last.problems) == described(fresh.problems)
        found |= {one.code for one in last.problems}
    assert len(found) > 2
