"""The command `envgraph optimise`: search for the best model."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from pathlib import Path
from typing import Any

from envgraph.cli._convert_command import check_format
from envgraph.cli._inputs import as_overrides
from envgraph.cli._match_and_apply import write_model
from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.errors import InvalidArgument
from envgraph.files import replace_file
from envgraph.graph import model_to_json
from envgraph.rewrite import trace_to_text
from envgraph.search import Domain, Optimum, optimisation_problem, optimise_domain


def optimise_model(
    problem: str,
    *,
    seed: int | None,
    steps: int | None,
    overrides: Sequence[str],
    solution: int,
    output: Path | None,
    trace: Path | None,
    picture: Path | None,
) -> int:
    """Optimise the model of a file, print the result, and write one solution; return exit code 1 if it is invalid.

    Args:
        problem: a family file with `[optimise]`, its directory, or a bundled domain.
        seed, steps, overrides: values that replace those of the file.
        solution: number of the solution in the Pareto front to write, from 1.
        output: path for the model.
        trace: path for the rule applications that lead to it, for `envgraph replay`.
        picture: path for the drawing of the front, as SVG.
    """
    if output is not None:
        check_format(output)
    given = as_overrides({"seed": seed, "optimise.steps": steps})
    domain = Domain.load(problem, overrides=[*given, *overrides])
    spec = domain.spec.optimise
    if picture is not None and spec is not None and len(spec.maximise + spec.minimise) < 2:
        raise InvalidArgument("`--picture` needs two objectives or more, but the file has one")
    with progress_bar("moves", spec.steps if spec else None) as advance:
        engine, found = optimise_domain(domain, progress=advance)
    if not 1 <= solution <= len(found.front):
        count = len(found.front)
        known = "there is one solution" if count == 1 else f"there are {count} solutions"
        raise InvalidArgument(f"`--solution` is {solution}, but {known}")
    chosen = found.front[solution - 1]
    engine.checkout(chosen.version)
    broken = (
        [str(one) for one in optimisation_problem(domain, engine).violated_constraints()] if chosen.violation else []
    )
    if not print_json(lambda: _result_data(domain, found) | {"violated": broken, "model": model_to_json(engine.model)}):
        _print_result(domain, found)
    if broken:
        print_line(f"no model that satisfies all constraints was found: {', '.join(broken)}")
    if output is not None:
        write_model(engine, output)
    for path, text in (
        (trace, trace and trace_to_text(engine, chosen.trace)),
        (picture, picture and _draw_front(domain, found)),
    ):
        if path is not None and text:
            replace_file(path, text)
            print_line(f"wrote {path}")
    return int(bool(broken))


def _result_data(domain: Domain, found: Optimum) -> dict[str, Any]:
    """Return the result as JSON-ready data; undefined values are None."""

    def without_infinity(values: Any) -> dict[str, float | None]:
        return {name: value if isfinite(value) else None for name, value in values.items()}

    return {
        "name": domain.spec.name,
        "steps": found.steps,
        "objectives": {goal.name: goal.sense for goal in found.goals},
        "initial": without_infinity(found.initial),
        "front": [
            {
                "values": without_infinity(one.values),
                "violation": one.violation,
                "applications": len(one.trace),
            }
            for one in found.front
        ],
    }


def _print_result(domain: Domain, found: Optimum) -> None:
    def row(label: str, values: Any, applications: str) -> tuple[str, ...]:
        return (
            label,
            *("no value" if value in (inf, -inf) else f"{value:.6g}" for value in values),
            applications,
        )

    single = len(found.goals) == 1
    rows = [row("initial", found.initial.values(), "")]
    for number, one in enumerate(found.front, start=1):
        rows.append(row("best" if single else str(number), one.values.values(), str(len(one.trace))))
    columns = ("solution", *(goal.name for goal in found.goals), "applications")
    moves = f"{found.steps:,} move{'s' * (found.steps != 1)} tried"
    print_table(f"{domain.spec.name}: {moves}", columns, rows, range(1, len(columns)))


def _draw_front(domain: Domain, found: Optimum) -> str:
    """Return an SVG chart of the Pareto front in the first two objectives; raise InvalidArgument for an empty chart."""
    from envgraph.report import Series, line_chart, standalone_chart

    first, second = (goal.name for goal in found.goals[:2])
    points = sorted({(one.values[first], one.values[second]) for one in found.front})
    points = [point for point in points if all(map(isfinite, point))]
    if not points:
        raise InvalidArgument("there is no front to draw: no solution has values of both objectives")
    xs, ys = zip(*points, strict=True)
    title = f"front of {domain.spec.name}"
    chart = line_chart([Series("front", xs, ys, has_points=True)], x_label=first, y_label=second, title=title)
    return standalone_chart(chart)
