"""Explain to users if a behaviour is compiled, and why not."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.behaviour import Behaviour
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._relations import ClosurePairs, PatternMatches
from envgraph.env.compiled.layout._symbols import AttributeColumn, ClassSet, LinkColumn, LinkMatrix
from envgraph.env.compiled.programs._compiled_program import CompiledProgram, program_of
from envgraph.rewrite import Engine


def explain_compilation(engine: Engine, behaviour: Behaviour) -> str:
    """Return a text that says what a compiled behaviour changes, or which construct cannot be compiled, and where."""
    try:
        program = program_of(engine, behaviour, native=False)
    except NotCompiled as refused:
        where = f"\n\n{refused.span}\n{refused.span.excerpt()}" if refused.span is not None else ""
        return f"environment {behaviour.name} steps on the live engine: {refused}{where}"
    return "\n".join([f"environment {behaviour.name} is compiled", *_program_facts(program)])


def _program_facts(program: CompiledProgram) -> Iterator[str]:
    arrays, columns = program.arrays, [column for column, _ in program.layout.columns()]
    features = [str(one.attribute) for one in columns if isinstance(one, AttributeColumn)]
    features += [str(one.reference) for one in columns if isinstance(one, LinkColumn | LinkMatrix)]
    classes = [one.cls for one in columns if isinstance(one, ClassSet)]
    relations = program.layout.relations()
    patterns = [one.pattern for one in relations if isinstance(one, PatternMatches)]
    patterns += [f"{one.step}{'*' if one.star else '+'}" for one in relations if isinstance(one, ClosurePairs)]
    size = 8 * (arrays.ints.shape[1] + arrays.floats.shape[1])
    yield f"  a state:  {size} bytes"
    yield f"  changes:  {', '.join(dict.fromkeys(features)) or 'no feature'}"
    if classes:
        yield f"            which objects are {', '.join(dict.fromkeys(classes))}"
    if written := [name for name in dict.fromkeys(patterns) if "#" not in name]:
        yield f"  tables:   {', '.join(written)}, computed once for each member of a family"
    yield f"  program:  {len(program.source.splitlines())} lines"
