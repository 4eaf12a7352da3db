"""Files with mistakes, and what is said about them.

Each file in the directory of a language is a case; `<file>.expected` has the exact text. Files in `shared` are to be
imported. `pytest tests/golden --update-golden` writes the expected texts; read the difference before committing it.
"""

from pathlib import Path

import pytest

from envgraph.lang import TextFiles, load_workspace

HERE = Path(__file__).parent
KINDS = (".metamodel", ".ecore", ".model", ".xmi", ".query", ".vql", ".rules", ".environment", ".toml")


def texts() -> dict[str, str]:
    return {
        path.relative_to(HERE).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(HERE.rglob("*"))
        if path.suffix in KINDS
    }


def expected_texts() -> list[Path]:
    return [path for path in HERE.rglob("*.expected") if path.parent.name != "generated"]  # which is generated source


TEXTS = texts()
CASES = [name for name in TEXTS if not name.startswith("shared/")]


def diagnostics_text(name: str) -> str:
    said = load_workspace([name], files=TextFiles(TEXTS)).diagnostics
    return "\n\n".join(str(one) for one in said) + "\n" if said else "nothing is wrong\n"


@pytest.mark.parametrize("name", CASES)
def test_file_is_diagnosed_as_expected(name: str, request: pytest.FixtureRequest) -> None:
    expected = HERE / f"{name}.expected"
    said = diagnostics_text(name)
    if request.config.getoption("--update-golden", default=False):
        expected.write_text(said, encoding="utf-8")
    assert expected.is_file(), f"no {expected.name}: run pytest tests/golden --update-golden"
    assert said == expected.read_text(encoding="utf-8")


HINTLESS = ("there is no such file",)
"""What has no hint: nobody knows what to write instead."""


def test_every_expected_diagnostic_has_a_hint() -> None:
    for path in expected_texts():
        for said in path.read_text(encoding="utf-8").strip("\n").split("\n\n"):
            first = said.split("\n")[0]
            assert "\nhint: " in said or first == "nothing is wrong" or first.endswith(HINTLESS), said


def test_every_expected_text_belongs_to_a_case() -> None:
    found = {path.relative_to(HERE).as_posix() for path in expected_texts()}
    assert found <= {f"{name}.expected" for name in CASES}
