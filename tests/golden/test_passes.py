"""What each pass makes of the bodies of patterns: of `passes/x.query` the file `x.passes` says it.

`pytest tests/golden --update-golden` writes the files anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from envgraph.lang import load_workspace
from envgraph.match.passes import (
    FOR_VIEWS,
    ON_DEMAND,
    Pass,
    RewrittenBodies,
)
from envgraph.match.plan import CallGraph
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    UnequalAtom,
    ValuationAtom,
)

HERE = Path(__file__).parent / "passes"
PIPELINES: dict[str, tuple[Pass, ...]] = {"on demand": ON_DEMAND, "for views": FOR_VIEWS}


def goal_text(goal: Goal, body: Conjunction) -> str:
    def named(*variables: int) -> str:
        names = (body.names[v] if v < len(body.names) else f"#{v}" for v in variables)
        return ", ".join(names)

    match goal:
        case InstanceAtom(cls, variable):
            return f"{cls}({named(variable)})"
        case AttributeAtom(feature, one, other) | LinkAtom(feature, one, other):
            return f"{feature.owner}.{feature.name}({named(one, other)})"
        case CallAtom(pattern, arguments):
            return f"find {pattern}({named(*arguments)})"
        case ClosureAtom(step, closure, one, other):
            return f"find {step}{closure.value}({named(one, other)})"
        case UnequalAtom(one, other):
            return f"{named(one)} != {named(other)}"
        case ConditionAtom(_, reads):
            return f"check over {named(*(v for _, v in reads))}"
        case ValuationAtom(_, reads, result):
            return f"{named(result)} == eval over {named(*(v for _, v in reads))}"
        case AggregateAtom():
            return f"{named(goal.result)} == {goal.function} {goal_text(goal.relation, body)}"
        case AbsenceAtom(alternatives, outer):
            inner = (" and ".join(goal_text(each, body) for each in alternative) for alternative in alternatives)
            return f"neg for {named(*outer) or 'nothing'}: {' or '.join(inner)}"


def body_text(body: Conjunction) -> Iterator[str]:
    for variable, value in body.constants:
        yield f"    {body.names[variable] if variable < len(body.names) else f'#{variable}'} == {value!r}"
    for goal in body.goals:
        yield f"    {goal_text(goal, body)}"


def passes_text(library: Library) -> Iterator[str]:
    for pattern in library.patterns:
        name = pattern.qualified_name
        for number, lowered in enumerate(library.lowered_pattern(name).bodies, start=1):
            yield f"{name}, body {number}"
            yield from body_text(lowered)
            for pipeline, passes in PIPELINES.items():
                bodies = RewrittenBodies(library, CallGraph(library), passes)
                bodies.bodies_of(name)
                body = lowered
                for rewrite in passes:
                    after = rewrite(body, bodies)
                    if after != body:
                        yield f"  {pipeline}, {rewrite.__name__}"
                        yield from body_text(after)
                    body = after
                assert body == bodies.bodies_of(name)[number - 1]
        yield ""


@pytest.mark.parametrize("path", sorted(HERE.glob("*.query")), ids=lambda path: path.stem)
def test_passes_rewrite_pattern_bodies_as_expected(path: Path, request: pytest.FixtureRequest) -> None:
    workspace = load_workspace([str(path)])
    assert not workspace.diagnostics
    library = workspace.engine().library
    expected = path.with_suffix(".passes")
    text = "\n".join(passes_text(library))
    if request.config.getoption("--update-golden", default=False):
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


def test_every_pass_rewrites_a_body_of_an_expected_text() -> None:
    told = "".join(path.read_text(encoding="utf-8") for path in HERE.glob("*.passes"))
    for pipeline, passes in PIPELINES.items():
        for each in passes:
            assert f"  {pipeline}, {each.__name__}\n" in told
