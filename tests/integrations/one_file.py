"""The single file of PPO in the documentation; `make test-integrations` installs what it needs, and runs it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")

PPO = Path(__file__).parents[2] / "docs" / "examples" / "ppo.py"


def test_it_learns() -> None:
    command = [sys.executable, str(PPO), "--domain", "keydoor", "--total-steps", "90000"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    first, *_, last = [float(one[1]) for line in said if (one := re.search(r"success (\S+)", line))]
    assert first < last and last > 0.95
