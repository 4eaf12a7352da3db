"""A few cases of the campaigns that need little: what they read may be moved, and nobody runs them every day."""

from __future__ import annotations

from random import Random
from types import ModuleType

import pytest

from tests.campaigns import encodings, exporters, programs, readers


@pytest.mark.parametrize(("campaign", "cases"), [(readers, 4), (encodings, 4), (programs, 1), (exporters, 2)])
def test_a_fuzzing_campaign_runs_without_failures(campaign: ModuleType, cases: int) -> None:
    campaign.prepare()
    assert all(campaign.campaign(Random(f"envgraph {number}")) for number in range(cases))
