"""Parsers that were kept are those that Lark builds, and are built anew whenever the file is not what it should be."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from lark import Lark

from envgraph.errors import Source
from envgraph.lang import bundled_domain, data_path
from envgraph.lang.syntax._grammar import RECOVERY, build
from envgraph.lang.syntax._parsing import parse_tokens

TEXTS = {path.suffix[1:]: path.read_text(encoding="utf-8") for path in bundled_domain("keydoor").glob("*.*")}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes what Lark builds."""
    names: list[str] = []
    make = Lark.__init__

    def noted(self: Lark, grammar: object, **options: object) -> None:
        names.append(Path(str(getattr(grammar, "name", ""))).stem)
        make(self, grammar, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Lark, "__init__", noted)
    return names


def grammar(language: str, directory: Path = data_path("grammars")) -> object:  # noqa: B008
    return build(language, directory / f"{language}.lark", RECOVERY[language])


@pytest.mark.parametrize("language", RECOVERY)
def test_a_parser_that_was_kept_reads_the_same(language: str, cache: Path, built: list[str]) -> None:
    source = Source(f"a.{language}", TEXTS[language])
    damaged = Source(f"a.{language}", TEXTS[language].replace("}", "", 3).replace(";", "", 1))
    first, second = grammar(language), grammar(language)
    assert built == [language]
    for text in (source, damaged):
        (one, _), (other, _) = parse_tokens(first, text), parse_tokens(second, text)  # type: ignore[arg-type]
        assert one.tree == other.tree
        assert list(map(str, one.diagnostics)) == list(map(str, other.diagnostics))


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b'{"key": 1}', b"\xff", b"null"])
def test_a_damaged_file_is_replaced(content: bytes, cache: Path, built: list[str]) -> None:
    grammar("model")
    (cache / "grammar-model").write_bytes(content)
    grammar("model")
    grammar("model")
    assert built == ["model", "model"]


def test_another_grammar_or_half_a_file_is_not_believed(
    cache: Path, built: list[str], tmp_path: Path
) -> None:
    shutil.copytree(data_path("grammars"), tmp_path / "grammars")
    grammar("model", tmp_path / "grammars")
    common = tmp_path / "grammars" / "common.lark"
    common.write_text(common.read_text() + "\n// another one\n")
    grammar("model", tmp_path / "grammars")
    assert built == ["model", "model"]
    kept = cache / "grammar-model"
    kept.write_bytes(kept.read_bytes()[:-1])
    grammar("model", tmp_path / "grammars")
    assert built == ["model", "model", "model"]


def test_tables_of_one_language_are_not_those_of_another(cache: Path, built: list[str]) -> None:
    grammar("model")
    grammar("query")
    shutil.copy(cache / "grammar-query", cache / "grammar-model")
    grammar("model")
    assert built == ["model", "query", "model"]


def test_nothing_is_kept_where_that_is_off(
    cache: Path, monkeypatch: pytest.MonkeyPatch, built: list[str]
) -> None:
    monkeypatch.setenv("ENVGRAPH_CACHE", "off")
    grammar("model")
    grammar("model")
    assert built == ["model", "model"] and not cache.exists()
