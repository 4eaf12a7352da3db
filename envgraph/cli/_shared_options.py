"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from envgraph.errors import InvalidArgument, parse_int_within

RUNS = Path("runs")

PATH: Final = click.Path(path_type=Path)


def record_format(context: click.Context, parameter: click.Parameter, format: str) -> str:
    """Record the output format of the command, for `print_json` and for errors; return the format unchanged."""
    context.find_root().obj.append(format)
    return format


format_option = click.option(
    "--format",
    type=click.Choice(["text", "json"], case_sensitive=False),
    default="text",
    callback=record_format,
    expose_value=False,
    help="Print results and errors as text for people, or as one JSON document.",
)
run_argument = click.argument(
    "run", help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json)."
)
directory_option = click.option("--directory", "-d", type=PATH, default=RUNS, help="Directory of all runs.")
model_argument = click.argument("model", help="A model: a .model or .xmi file, any EMF model, or JSON.")
model_or_run_argument = click.argument(
    "model",
    help="A model: a .model or .xmi file, any EMF model, or JSON; with --variant a run or a family file (.json).",
)
variant_option = click.option("--variant", help="Only this environment of a run or family: its name (E6) or number.")
metamodel_option = click.option(
    "--metamodel",
    "-m",
    multiple=True,
    help="A .ecore or .metamodel file; other files may import it by its URI, but need not. "
    "Repeat the option for several .ecore files, which become one metamodel.",
)
unresolved_option = click.option(
    "--allow-unresolved",
    is_flag=True,
    help="Leave out links of EMF models to missing files and objects, with a warning.",
)
Command = Callable[..., Any]
_Command = TypeVar("_Command", bound=Command)


def implemented_in(module: str, name: str) -> Callable[[Command], Command]:
    """Return a decorator for a command that imports a module of `envgraph.cli` when called, and calls `name` in it."""

    def make_lazy_command(declared: Command) -> Command:
        @wraps(declared)
        def run(**given: Any) -> Any:
            return getattr(import_module(f"envgraph.cli.{module}"), name)(**given)

        run.__dict__["done_in"] = f"envgraph.cli.{module}", name
        return run

    return make_lazy_command


def inputs_options(command: Command) -> Command:
    """Add `--metamodel` and `--allow-unresolved` to a command; it receives them in the argument `inputs`."""

    @wraps(command)
    def read(metamodel: tuple[str, ...], allow_unresolved: bool, variant: str | None = None, **rest: Any) -> Any:
        from envgraph.cli._inputs import Inputs

        return command(inputs=Inputs(metamodel, allow_unresolved, variant), **rest)

    return metamodel_option(unresolved_option(read))


definitions_argument = click.argument(
    "definitions", metavar="FILE", help="A .query, .vql, .rules or .environment file."
)
where_option = click.option(
    "--where",
    "-w",
    metavar="NAME=VALUE",
    multiple=True,
    help="Fix a parameter: an object by its name, key or number, or a value.",
)
overrides_option = click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Replace a setting of the family file, such as search.population=10; may be repeated.",
)


def workers_options(help: str, *aliases: str) -> Callable[[Command], Command]:
    """Return a decorator that adds `--workers` and `--cluster`; the command runs where they say."""

    def decorate(command: Command) -> Command:
        @wraps(command)
        def run(cluster: str | None, workers: int, **rest: Any) -> Any:
            from envgraph.files import cluster_workers

            with cluster_workers(cluster, workers) as available:
                return command(workers=available, **rest)

        count = count_option("--workers", *aliases, default=1, help=f"{help} Does not change results.")
        return count(_cluster_option(run))

    return decorate


_cluster_option = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Run on all workers of a cluster: dask://HOST:PORT, ray://HOST:PORT, or ray for this machine.",
)
_MAX_VALUES: Final = {
    **dict.fromkeys(("--population", "--members", "--samples", "--seeds", "--controls"), "members"),
    **{"--seed": "seed", "--seed-offset": "seed", "--times": "attempts", "--workers": "workers"},
}
"""The limit of each numeric option; "steps" for all other options."""


class _WholeNumber(click.IntRange):
    """A type of integer options: from `min` to the limit of the option in `_MAX_VALUES`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse the number, or report it as an error of the command line."""
        assert param is not None and self.min is not None
        try:
            return parse_int_within(str(value), int(self.min), _MAX_VALUES.get(param.opts[0], "steps"))
        except InvalidArgument as error:
            self.fail(str(error), param, ctx)


def count_option(
    *names: str, minimum: int = 1, default: int | None = None, default_text: str = "", help: str
) -> Callable[[_Command], _Command]:
    """Return a decorator that adds an integer option; `default_text` describes the default in the help if it is not
    fixed.
    """
    shown: dict[str, Any] = (
        {"show_default": default_text} if default_text else {} if default is None else {"default": default}
    )
    return click.option(*names, type=_WholeNumber(minimum), help=help, **shown)


seed_option = count_option("--seed", minimum=0, help="Random seed, instead of that in the file.")
force_option = click.option(
    "--force",
    is_flag=True,
    help="Replace the run of that name, with its training and report, if there is one.",
)
