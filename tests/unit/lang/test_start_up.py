"""What reading files and matching do without: it would take longer to import than a small command runs."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("gymnasium", "jinja2", "jsonschema", "networkx", "numpy", "rich", "urllib.request")


def test_a_query_is_read_and_matched_without_gymnasium_and_numpy() -> None:
    code = (
        "import sys, envgraph; engine = envgraph.open('social_media'); assert engine.count('thread') >= 0;"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
