"""Texts before and after formatting.

Each `format/<name>.<language>.before` is a case; `<name>.<language>.after` has the exact text. `pytest tests/golden
--update-golden` writes those; read the difference before committing it.
"""

from pathlib import Path

import pytest

from envgraph.lang import format_text

HERE = Path(__file__).parent / "format"
CASES = sorted(HERE.glob("*.before"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_text_is_formatted_as_expected(case: Path, request: pytest.FixtureRequest) -> None:
    language = case.stem.rpartition(".")[2]
    after = case.with_suffix(".after")
    formatted = format_text(language, case.read_text(encoding="utf-8"))
    if request.config.getoption("--update-golden", default=False):
        after.write_text(formatted, encoding="utf-8")
    assert formatted == after.read_text(encoding="utf-8")
    assert format_text(language, formatted) == formatted


def test_there_is_a_case_for_each_language() -> None:
    assert {case.stem.rpartition(".")[2] for case in CASES} == {
        "metamodel", "model", "query", "rules", "environment",
    }  # fmt: skip
