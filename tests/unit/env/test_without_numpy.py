"""Domains are checked, drawn and played where NumPy, Gymnasium and others are not installed, as in a browser."""

from __future__ import annotations

import subprocess
import sys

MISSING = ("click", "gymnasium", "jinja2", "joblib", "jsonschema", "networkx", "numba", "numpy", "rich")
PLAY = """
from random import Random

from envgraph.env import PlayedEpisode, Simulator, scene_svg, scene_text
from envgraph.errors import RuleError
from envgraph.lang import bundled_domains, open_workspace
from envgraph.learn.audit import check_audit
from envgraph.search import check_domain

for domain in bundled_domains():
    workspace = open_workspace(domain)
    for spec in workspace.families:
        print(check_domain(spec, workspace, False), check_audit(spec, workspace))
    engine = workspace.engine(seed=1)
    model = engine.model
    assert "<svg" in model.picture().to_svg(graphviz=False)
    start = model.state_hash()
    print(domain, *(engine.count(pattern) for pattern in engine.patterns))
    for rule in engine.rules[:4]:
        savepoint = model.graph.history.savepoint()
        try:
            print(rule, engine.apply(rule, choose="first"), model.state_hash())
        except RuleError as refusal:
            print(refusal)
        model.graph.history.rollback(savepoint)
    assert model.state_hash() == start
    for behaviour in workspace.behaviours:
        rng, simulator = Random(1), Simulator(engine, behaviour)
        print(simulator.reset(rng))
        for _ in range(20):
            allowed = [number for number, can in enumerate(simulator.allowed_actions()) if can]
            outcome = simulator.step(allowed[int(rng.random() * len(allowed))], rng)
            print(outcome, scene_text(simulator.painter().draw()))
            if outcome.terminated:
                break
        print(scene_svg(simulator.painter().draw()))
        simulator.close()
        episode = PlayedEpisode(simulator, None, rng.random)
        print(episode.choose(episode.bindings.popitem()[1]), episode.allowed, episode.undo(), episode.bindings)
        episode.close()
"""


def test_models_are_played_without_numpy_and_with_equal_results() -> None:
    without = f"import sys; sys.modules.update(dict.fromkeys({MISSING!r}))\n{PLAY}"  # importing None fails
    found = [run(program) for program in (PLAY, without)]
    assert found[0] == found[1]
    assert found[0].count("StepOutcome") > 100


def run(program: str) -> str:
    """Return what a program prints, run in a process of its own."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
