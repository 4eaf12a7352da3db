"""`envgraph.sb3` without Stable-Baselines3; tests/integrations/sb3_vectors.py has it."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "envgraph.sb3", raising=False)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.monitor", None)
    with pytest.raises(ImportError, match=r"needs Stable-Baselines3: pip install 'envgraph\[sb3\]'"):
        import_module("envgraph.sb3")
