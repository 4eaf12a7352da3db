"""A generated family and published files, shared by the tests of the search."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.search import Family, generate

PUBLISHED = Path(__file__).parents[3] / "envgraph" / "report" / "reproduction" / "data"


@pytest.fixture(scope="session")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    """The Burning Forest at the paper's settings."""
    return generate("burning_forest/paper.toml", tmp_path_factory.mktemp("runs") / "full" / "run.sqlite")


@pytest.fixture(scope="session")
def published() -> Path:
    """The published family."""
    return PUBLISHED / "environment-config.json"


@pytest.fixture(scope="session")
def published_files() -> list[Path]:
    """The published family and the thirty random ones."""
    return [PUBLISHED / "environment-config.json", *sorted((PUBLISHED / "random-families").glob("*.json"))]
