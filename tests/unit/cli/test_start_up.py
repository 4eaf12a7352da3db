"""What small commands do without: it would take longer to import than they run."""

from __future__ import annotations

import subprocess
import sys

import pytest

from envgraph.lang import data_path

HEAVY = ("gymnasium", "jinja2", "jsonschema", "networkx", "numpy", "pydantic", "rich", "urllib.request")
QUERY = str(data_path("rules", "social_media", "social_media.query"))


@pytest.mark.parametrize(
    "code",
    [
        "import envgraph.lang",
        "import envgraph; envgraph.open('social_media').count('thread')",
        f"import envgraph.cli as cli; sys.argv = ['envgraph', 'check', {QUERY!r}]; assert cli.main() == 0",
    ],
)
def test_files_are_read_and_matched_without_what_is_slow_to_import(code: str) -> None:
    program = f"import sys; {code}; print(*[name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
