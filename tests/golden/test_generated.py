"""All functions that are generated for the bundled domains: what was asked, how many texts, and what they hash to.

Those of one domain stand as a whole in `generated/keydoor.py.expected`. `pytest tests/golden --update-golden` writes
the files anew. To see what has changed, write all texts to a directory before and after: `--generated DIRECTORY`.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import pytest

import envgraph
from envgraph.code import _compile_text
from envgraph.lang import bundled_domain, bundled_domains
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.rewrite import Engine

HERE = Path(__file__).parent / "generated"
SHOWN = "keydoor"
"""The domain of which some texts are shown."""

Texts = dict[str, list[str]]
"""For each question the texts that were generated for it, in the order in which they are first needed."""


def questions(engine: Engine) -> Iterator[str]:
    """Ask everything; before each question its name."""
    for unit, program in engine.catalog.programs.items():
        yield f"unit {unit}"
        assert program.source
    library = engine.library
    matcher = CompiledMatcher(engine.model, library)
    for pattern in library.patterns:
        name, width = pattern.qualified_name, len(pattern.parameters)
        row = None
        for bound in dict.fromkeys([(), *((n,) for n in range(width)), tuple(range(width))]):
            place = f"{name} {bound}"
            yield f"rows {place}"
            matcher.prepare(name, bound)
            yield f"seek {place}"
            matcher.prepare_iterator(name, bound)
            row = row or matcher.first(name, (FREE,) * width)
            if row is not None:
                values = tuple(row[n] if n in bound else FREE for n in range(width))
                for mode in ("first", "exists", "count"):
                    yield f"{mode} {place}"
                    getattr(matcher, mode)(name, values)
        yield f"explain {name}"
        matcher.explain(name)
        yield f"why not {name}"
        matcher.why_not(name, {})
    yield "watch"
    assert isinstance(engine.matcher, ViewMatcher)
    engine.matcher.watch_later(*(p.qualified_name for p in library.patterns if p.strategy != "search"))
    assert engine.watched
    for pattern in library.patterns:
        yield f"explain watched {pattern.qualified_name}"
        engine.matcher.explain(pattern.qualified_name)


def generated(domain: str) -> Texts:
    """All texts of a domain, each where it is first needed."""
    found: Texts = {}
    asked = "open"
    compiled = _compile_text.compile_cached

    def noted(text: str, file: str) -> object:
        if file != "<data class>":  # those are made once in a process
            found.setdefault(asked, []).append(f"# {file}\n{text}")
        return compiled(text, file)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_compile_text, "compile_cached", noted)
        engine = envgraph.open(bundled_domain(domain), seed=1)
        for asked in questions(engine):  # noqa: B007
            pass
    return found


def digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:16]


@pytest.mark.parametrize("domain", bundled_domains())
def test_generated_functions_equal_the_expected_texts(domain: str, request: pytest.FixtureRequest) -> None:
    texts = generated(domain)
    if directory := request.config.getoption("--generated", default=None):
        for asked, each in texts.items():
            path = Path(directory) / domain / f"{asked}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("\n".join(each), encoding="utf-8")
    summary = [f"{asked}: {len(each)} {digest(chr(10).join(each))}" for asked, each in texts.items()]
    expected = {HERE / f"{domain}.expected": "\n".join([*summary, ""])}
    if domain == SHOWN:
        shown = dict.fromkeys(text for asked, each in texts.items() if "explain" not in asked for text in each)
        expected[HERE / f"{domain}.py.expected"] = "\n".join(shown)
    for path, now in expected.items():
        if request.config.getoption("--update-golden", default=False):
            path.parent.mkdir(exist_ok=True)
            path.write_text(now, encoding="utf-8")
        assert path.read_text(encoding="utf-8") == now, "see the head of this file"
