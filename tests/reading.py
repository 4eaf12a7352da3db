"""Read texts that a test has at hand, each as a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from envgraph.errors import LoadError, Source
from envgraph.graph import Model
from envgraph.lang import DiskFiles, FamilySpec, Files, TextFiles, find_family, load_workspace
from envgraph.lang.family._family_reader import read_family
from envgraph.lang.read._environment_reader import read_environment
from envgraph.lang.read._metamodel_reader import MetamodelFile, read_metamodel
from envgraph.lang.read._model_reader import ModelFile, read_models
from envgraph.lang.read._query_header import DefinitionsFile
from envgraph.lang.read._query_reader import read_query
from envgraph.lang.read._rules_reader import read_rules
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.syntax._parser import parse
from envgraph.lang.syntax._toml_parser import TomlText, parse_toml
from envgraph.metamodel import Metamodel

_READERS: dict[str, Callable[[Any], DefinitionsFile[Any]]] = {
    "query": read_query,
    "rules": read_rules,
    "environment": read_environment,
}


def read_definitions(text: str, language: str, name: str = "t") -> DefinitionsFile[Any]:
    """Return what a text defines, and its mistakes, before any name is looked up.

    Args:
        text: the content of a file.
        language: "query", "rules" or "environment".
        name: the file that diagnostics name, without its suffix.
    """
    return _READERS[language](parse(language, Source(f"{name}.{language}", text)))


def read_metamodel_text(text: str) -> MetamodelFile:
    """Return the metamodel of a text, and its mistakes."""
    return read_metamodel(parse("metamodel", Source("m.metamodel", text)))


def read_model_text(text: str, metamodel: Metamodel | None) -> ModelFile:
    """Return the models of a text, and their mistakes."""
    return read_models(parse("model", Source("a.model", text)), metamodel)


def read_tree(text: str, language: str) -> object:
    """Return the syntax tree of a text; None if the text has errors of syntax."""
    parsed = parse(language, Source(f"t.{language}", text))
    return None if parsed.diagnostics else parsed.tree


def lexeme_places(text: str, language: str) -> list[tuple[int, int]]:
    """Return where each lexeme of a text without errors begins and ends."""
    lexemes = load_grammar(language).lexer.split_text(Source(f"t.{language}", text)).lexemes
    return [(lexeme.start, lexeme.end) for lexeme in lexemes]


def read_toml(text: str) -> TomlText:
    """Return the data of a TOML text, and the place of each value and key."""
    return parse_toml(Source("a.toml", text))


def load_family(path: str, files: Files | None = None) -> FamilySpec:
    """Read a family file whose names may mean nothing; raise LoadError with all that is wrong with its text."""
    files = files or DiskFiles()
    found = read_family(find_family(path, files), files)
    if found.diagnostics:
        raise LoadError(found.diagnostics)
    return found.spec


def parse_ecore(source: Source) -> Metamodel:
    """Return the metamodel of the text of an `.ecore` file; raise LoadError with all that is wrong with it."""
    found = load_workspace([source.name], files=TextFiles({source.name: source.text}))
    found.raise_errors()
    assert found.metamodel is not None
    return found.metamodel


def parse_xmi(source: Source, metamodel: Metamodel, *, allow_unresolved: bool = False) -> Model:
    """Return the model of the text of an `.xmi` file; raise LoadError with all that is wrong with it."""
    files = TextFiles({source.name: source.text})
    found = load_workspace([source.name], files=files, metamodel=metamodel, allow_unresolved=allow_unresolved)
    return found.model()
