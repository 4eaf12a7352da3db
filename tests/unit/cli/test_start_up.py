"""What small commands do without: it would take longer to import than they run."""

from __future__ import annotations

import subprocess
import sys

import pytest

from envgraph.lang import data_path

HEAVY = (
    "gymnasium",
    "jinja2",
    "jsonschema",
    "networkx",
    "numpy",
    "pydantic",
    "rich.console",
    "urllib.request",
)
UNUSED = ("behaviour", "env", "lang.format", "lang.interchange", "lang.write", "rewrite.derive", "search")
"""What reads no file of burning_forest but its environment and family."""
LATE = (*HEAVY, *(f"envgraph.{name}" for name in UNUSED))
QUERY = str(data_path("rules", "social_media", "social_media.query"))
MODEL, TILES = (str(data_path("rules", "burning_forest", one)) for one in ("running_4x4.model", "burning_forest.query"))


@pytest.mark.parametrize(
    "code",
    [
        "import envgraph.lang",
        "import envgraph; envgraph.open('social_media').count('thread')",
        f"import envgraph.cli as cli; sys.argv = ['envgraph', 'check', {QUERY!r}]; assert cli.main() == 0",
        "import envgraph.cli as cli; "
        f"sys.argv = ['envgraph', 'match', {MODEL!r}, {TILES!r}, 'neighbour']; assert cli.main() == 0",
    ],
)
def test_reading_and_matching_files_does_not_import_slow_modules(code: str) -> None:
    program = f"import sys; {code}; print(*[name for name in {LATE!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""


def test_checking_a_family_does_not_import_the_environment_package() -> None:
    late = (*HEAVY, "envgraph.env", "sqlite3")
    code = "import envgraph.cli as cli; sys.argv = ['envgraph', 'check', 'burning_forest']; assert cli.main() == 0"
    program = f"import sys; {code}; print(*[name for name in {late!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
