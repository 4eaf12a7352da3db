"""Rewards and weights whose sums would not be finite are errors at their place, on every engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envgraph.env import Behaviour, Simulator, Tabular, explore
from envgraph.env.compiled import CompiledBatch, enumerate_states, program_of
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.lang import load_workspace
from envgraph.rewrite import Engine
from tests.unit.learn.small_tables import table

FILES = {
    "d.metamodel": "metamodel d\nclass H { int n = 0 }\n"
    "class W { contains H[*] all float f = 1e308 float g = -1e101 float h = 1e100 }",
    "d.query": 'package d\nimport "d.metamodel"\npattern each(h : H) { H(h); }\npattern no(h : H) { H.n(h, -1); }',
    "d.rules": 'package d\nimport "d.query"\nrule go(h : H) { lhs { check h.n < 9; } modify { set h.n += 1; } }\n'
    "rule never(h : H) { lhs { check h.n < 0; } modify { } }",
    "d.model": 'import "d.metamodel"\nmodel d : d { w : W { all = [a : H {}, b : H {}] } }',
}

LARGE = {
    "action go = go(a) reward <w.f>": "a reward is 1e+308",
    "action go = go(a) reward <w.g>": "a reward is -1e+101",
    "action go = go(a) reward <1e200>": "a reward is 1e+200",
    "action go = go(a) reward <w.h * 2>": "a reward is 2e+100",
    "action go = never(a) reward 1 else reward <w.f>": "a reward is 1e+308",
    "action go = go(a)\neach step reward <w.f>": "a reward is 1e+308",
    "action go = go(a)\non find each(_) reward <w.f>": "a reward is 1e+308",
    "action go = go(a)\non find each(x) reward <x.n * w.f>": "a reward is 1e+308",
    "action go = go(a)\non find each(x) apply go(x) weight <w.f>": "a weight is 1e+308",
    "action go = go(a)\non neg find no(a) reward <w.f> terminate failure": "a reward is 1e+308",
}


@pytest.mark.parametrize("clause", LARGE)
def test_all_engines_report_the_same_error_for_too_large_numbers(clause: str, tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, clause.replace("<", "", 1).replace(">", "", 1))
    said = []
    with pytest.raises(EvaluationError) as caught:
        live = Simulator(engine.copy(), behaviour)
        live.reset(np.random.default_rng(0))
        live.step(0, np.random.default_rng(0))
    said.append(str(caught.value))
    with pytest.raises(EvaluationError) as caught:
        explore(engine.copy(), behaviour)
    said.append(str(caught.value))
    with pytest.raises(EvaluationError) as caught:
        enumerate_states(program_of(engine, behaviour, native=False))
    said.append(str(caught.value))
    with pytest.raises(EvaluationError) as caught:
        batch = CompiledBatch(program_of(engine, behaviour, native=False), [0])
        batch.reset(np.ones(1, dtype=np.bool_))
        batch.step(np.zeros(1, dtype=np.int64), resets_ended=False)
    said.append(str(caught.value))
    assert said == [said[0]] * 4
    assert f"{LARGE[clause]}, but must be from -1e+100 to 1e+100" in said[0]
    marked = clause[clause.index("<") + 1 : clause.index(">")]
    assert caught.value.span is not None and caught.value.span.text == marked


def test_the_largest_rewards_are_paid(tmp_path: Path) -> None:
    engine, behaviour = written(
        tmp_path, "action go = go(a) reward w.h\neach step reward -1e100 + 1.0\non find each(x) reward w.h"
    )
    paid = enumerate_states(program_of(engine, behaviour, native=False)).reward
    assert paid.max() == 2e100 and np.array_equal(paid, explore(engine, behaviour).tabular.reward)


def test_tables_refuse_rewards_outside_the_range() -> None:
    def paying(reward: float) -> Tabular:
        return table([[[(1.0, 0, reward, 0)]]])

    paying(-2e100).check()  # of two clauses
    for reward in (1e111, -1e308, np.inf, np.nan):
        with pytest.raises(InvalidArgument, match=r"`reward` has values outside of the range from -1e\+110 to 1e\+110"):
            paying(reward).check()


def written(folder: Path, clauses: str) -> tuple[Engine, Behaviour]:
    text = (
        'import "d.query"\nimport "d.rules"\n'
        f"environment D(w : W, a : H) {{\n{clauses}\nobserve a.n in 0..9\nlimit 9 steps\n}}"
    )
    for name, content in {**FILES, "d.environment": text}.items():
        (folder / name).write_text(content, encoding="utf-8")
    workspace = load_workspace([str(folder / "d.environment"), str(folder / "d.model")])
    engine = Engine(workspace.models[0].model)
    engine.add(*workspace.definitions)
    return engine, workspace.behaviour()
