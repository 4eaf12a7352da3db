"""What units do: each example of `runs/*.txt` has definitions with a unit `u`, and what running it gives.

`pytest tests/golden --update-golden` writes the results anew; read the difference before committing it.

The model has three items, whose `n` is their number, linked by `next`: 0 -> 1 -> 2. The rules and patterns at the
beginning of `runs/rules.txt` are there in all examples. The generator begins at seed 1.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import EnvgraphError
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import chain, definitions, patterns, problems

HERE = Path(__file__).parent / "runs"
RULES = (HERE / "rules.txt").read_text(encoding="utf-8")
QUERIES = """
pattern big(a : Item) { Item.n(a, n); check(n > 1); }
pattern wide(a : Thing) { Thing(a); }
pattern linked(a : Item, b : Item) { Item.links(a, b); }
"""
FILES = [path for path in sorted(HERE.glob("*.txt")) if path.name != "rules.txt"]


def examples(path: Path) -> list[tuple[str, str, str]]:
    """Title, definitions and result of every example of a file."""
    found = []
    for part in path.read_text(encoding="utf-8").removeprefix("=== ").split("\n=== "):
        title, _, rest = part.partition("\n")
        text, _, expected = rest.partition("\n---\n")
        found.append((title, text, expected.strip("\n")))
    return found


def result_of(text: str) -> str:
    """What is wrong with the definitions, or what running `u` gives."""
    found = problems(f"{text}\n{RULES}", QUERIES)
    if found:
        return "\n\n".join(map(str, found))
    engine = Engine(chain(3), seed=1)
    engine.add(*patterns(QUERIES), *definitions(f"{text}\n{RULES}"))
    engine.step_limit = 60
    taken = [parameter.name for parameter in engine.signature("u").parameters if parameter.is_required]
    try:
        run = engine.run("u", **dict.fromkeys(taken, 0))
    except EnvgraphError as error:
        lines = [f"{type(error).__name__}: {error}"]
    else:
        lines = ["succeeded" if run else f"failed: {run.reason}"]
        lines += [f"  {name} = {value}" for name, value in run.outputs.items()]
        lines += [f"  {rule}{values}" for rule, values in run.firings]
    engine.check_integrity()
    state = ", ".join(f"{node.id} n={node.n}" for node in engine.model.nodes("Item"))
    return "\n".join([*lines, f"items: {state}"])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_unit_runs_equal_the_results_in_the_file(path: Path, request: pytest.FixtureRequest) -> None:
    said = [(title, text, result_of(text)) for title, text, _ in examples(path)]
    if request.config.getoption("--update-golden", default=False):
        parts = [f"=== {title}\n{text}\n---\n{result}\n" for title, text, result in said]
        path.write_text("\n".join(parts), encoding="utf-8")
    for (title, _, result), (_, _, expected) in zip(said, examples(path), strict=True):
        assert result == expected, title
