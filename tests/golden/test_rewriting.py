"""Rules, and what applying them does.

Each rule of a file in `rewriting` is applied to the shelf of `shared`, always in the state of the file, at the first of
its matches; `<file>.applied` says what comes of it. "Given a = red." in the documentation of a rule binds a variable.
`pytest tests/golden --update-golden` writes the texts anew.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from envgraph.errors import EnvgraphError, EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Attribute
from envgraph.pattern import Rule
from envgraph.rewrite import Engine
from tests.golden.test_golden import TEXTS

HERE = Path(__file__).parent
CASES = [name for name in TEXTS if name.startswith("rewriting/")]


def facts(model: Model) -> dict[str, None]:
    """Everything that a model says, one fact a line; a link and its opposite are one."""
    found: dict[str, None] = {}
    for node in model.nodes():
        name = model.graph.describe(node.id).strip("`")
        found[f"{name} : {node.cls}"] = None
        for feature in model.metamodel.features(node.cls).values():
            if isinstance(feature, Attribute):
                found[f"{name}.{feature.name} = {model.graph.value(node.id, feature)!r}"] = None
                continue
            opposite = model.metamodel.opposite(feature)
            for target in model.graph.targets(node.id, feature):
                if opposite is None or (feature.index, node.id) <= (opposite.index, target):
                    found[f"{name} -{feature.name}-> {model.graph.describe(target).strip('`')}"] = None
    return found


def given(rule: Rule, model: Model) -> dict[str, object]:
    """What the documentation of a rule binds: names of objects, whole numbers, literals."""
    said = re.search(r"Given (.*?)\.$", rule.doc or "", re.MULTILINE)
    pairs = [pair.split(" = ") for pair in said.group(1).split(", ")] if said else []
    found: dict[str, object] = {}
    for name, value in pairs:
        literal = value.removeprefix("::")
        found[name] = literal if literal != value else int(value) if value.isdigit() else model[value]
    return found


def applied(rule: Rule, engine: Engine) -> list[str]:
    """What applying a rule says."""
    model, name = engine.model, rule.name
    bound = given(rule, model)
    matches = sorted(engine.matches(name, **bound), key=lambda match: repr(match.row))
    lines = [f"matches: {len(matches)}"]
    if not matches:
        return [*lines, *str(engine.why_not(name, **bound)).splitlines()[:2]]
    lines.append("at " + ", ".join(f"{key} = {shown(model, value)}" for key, value in matches[0].items()))
    before = facts(model)
    try:
        application = engine.apply(name, matches[0])
    except (RuleError, EvaluationError) as error:
        assert facts(model) == before
        reason = f"refused ({error.reason})" if isinstance(error, RuleError) else "no value"
        return [*lines, *f"{reason}: {error}".splitlines()]
    assert application is not None
    after = facts(model)
    lines += [f"- {fact}" for fact in before if fact not in after]
    lines += [f"+ {fact}" for fact in after if fact not in before]
    lines += [f"out {key} = {shown(model, value)}" for key, value in application.outputs.items()]
    lines += [f"notice: {notice.message}" for notice in engine.notices]
    model.check_integrity()
    return lines


def shown(model: Model, value: object) -> str:
    identity = getattr(value, "id", None)
    return repr(value) if identity is None else model.graph.describe(identity).strip("`")


def applications_text(name: str) -> str:
    workspace = load_workspace([name, "shared/shelf.model"], files=TextFiles(TEXTS))
    parts = []
    for rule in workspace.definitions:
        if isinstance(rule, Rule):
            lines = applied(rule, workspace.engine(seed=0).copy())
            parts.append("\n    ".join([f"rule {rule.name}", *lines]))
    return "\n\n".join(parts) + "\n"


@pytest.mark.parametrize("name", CASES)
def test_rule_applications_equal_the_expected_texts(name: str, request: pytest.FixtureRequest) -> None:
    expected = HERE / f"{name.removesuffix('.rules')}.applied"
    done = applications_text(name)
    if request.config.getoption("--update-golden", default=False):
        expected.write_text(done, encoding="utf-8")
    assert expected.is_file(), f"no {expected.name}: run pytest tests/golden --update-golden"
    assert done == expected.read_text(encoding="utf-8")


def test_every_expected_text_belongs_to_a_case() -> None:
    found = {path.relative_to(HERE).as_posix() for path in HERE.rglob("*.applied")}
    assert found == {f"{name.removesuffix('.rules')}.applied" for name in CASES}


def test_unknown_argument_of_a_rule_is_an_error() -> None:
    workspace = load_workspace(["rewriting/arrows.rules", "shared/shelf.model"], files=TextFiles(TEXTS))
    with pytest.raises(EnvgraphError):
        workspace.engine(seed=0).matches("forward", nothing=1)
