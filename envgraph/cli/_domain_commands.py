"""Commands on the files of a domain: what they are called and what they take. What they do is in other modules."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from envgraph.cli._app import app
from envgraph.cli._options import (
    PATH,
    count_option,
    definitions_argument,
    format_option,
    inputs_options,
    model_argument,
    model_or_run_argument,
    overrides_option,
    variant_option,
    where_option,
)
from envgraph.cli._output import OutputFormat, print_line

if TYPE_CHECKING:  # it reads the languages, which not every command does
    from envgraph.cli._inputs import Inputs


@app.command()
@click.argument("name", help="Name of the domain: small letters, digits and `_`.")
@click.option(
    "--directory", "-d", type=PATH, show_default="a directory of that name", help="Where to put it."
)
@click.option("--domain", help="Copy the files of this bundled domain instead.")
def new(name: str, directory: Path | None, domain: str | None) -> None:
    """Write a small domain to start from: a grid, a robot, rules, rewards, a family of mazes. Or copy a bundled one."""
    from envgraph.cli._new import copy_domain, write_domain

    place = directory or Path(name)
    files = write_domain(place, name) if domain is None else copy_domain(place, name, domain)
    for path in files:
        print_line(f"wrote {path}")
    commands = {"family.toml": f"generate {place}", "problem.toml": f"optimise {place}"}
    known = [commands[path.name] for path in files if path.name in commands]
    print_line(f"next: envgraph {known[0] if known else f'check {files[0]}'}")


@app.command()
@click.argument("environment", help="An id of Gymnasium, such as FrozenLake-v1.")
@click.option("--output", "-o", type=PATH, show_default="a directory of that name", help="Where to put it.")
@click.option(
    "--set",
    "options",
    metavar="KEY=VALUE",
    multiple=True,
    help="An option of the environment, such as is_slippery=false; may be repeated.",
)
@count_option("--seed", least=0, default=0, help="Seed of the level of MiniGrid.")
@format_option
def adopt(
    environment: str, output: Path | None, options: tuple[str, ...], seed: int, format: OutputFormat
) -> None:
    """Write a domain that steps as an environment of Gymnasium does: one that tells its transitions, as FrozenLake, or
    a level of MiniGrid.
    """
    from envgraph.cli._adopt import adopt_environment

    adopt_environment(environment, output, options, seed, format)


@app.command()
@click.argument(
    "files",
    nargs=-1,
    required=True,
    help="Files of any of the languages, family files, directories, or bundled domains.",
)
@inputs_options
@click.option(
    "--ignore", metavar="CODE", multiple=True, help="Leave out warnings of this code; may be repeated."
)
@overrides_option
@format_option
def check(
    files: tuple[str, ...],
    inputs: Inputs,
    ignore: tuple[str, ...],
    overrides: tuple[str, ...],
    format: OutputFormat,
) -> int:
    """Read files and everything they import, and print all problems: position, line, hint. Exit code 1 on errors."""
    from envgraph.cli._check import check_files

    return check_files(files, inputs, format, ignore, overrides)


@app.command("format")
@click.argument(
    "files",
    nargs=-1,
    required=True,
    help="Files of any of the five languages, or directories of them; `-` is standard input.",
)
@click.option(
    "--check", is_flag=True, help="Write nothing; list what would change, exit code 1 if anything would."
)
@click.option("--stdout", is_flag=True, help="Print the texts and leave the files alone.")
@click.option("--language", help="What standard input is: query, rules ...")
@click.option(
    "--derived", is_flag=True, help="Print the rules that `derive` stands for in .rules files instead."
)
def format_(files: tuple[str, ...], check: bool, stdout: bool, language: str | None, derived: bool) -> int:
    """Write files in the one style: indentation, blanks, line ends; comments stay. Files with errors are left alone."""
    from envgraph.cli._format import format_files, print_derived

    if derived:
        print_derived(files)
        return 0
    return format_files(files, check=check, stdout=stdout, language=language)


@app.command()
@model_or_run_argument
@click.argument("queries", metavar="QUERYFILE", help="A .query or .vql file.")
@click.argument("pattern", help="Name of a pattern, simple or qualified.")
@where_option
@variant_option
@inputs_options
@format_option
def match(
    model: str,
    queries: str,
    pattern: str,
    where: tuple[str, ...],
    inputs: Inputs,
    format: OutputFormat,
) -> None:
    """Print the matches of a pattern in a model."""
    from envgraph.cli._query import print_matches

    print_matches(model, queries, pattern, where, inputs, format)


@app.command()
@model_or_run_argument
@definitions_argument
@click.argument("name", help="Name of a pattern, rule or environment.")
@where_option
@variant_option
@inputs_options
@format_option
def explain(
    model: str,
    definitions: str,
    name: str,
    where: tuple[str, ...],
    inputs: Inputs,
    format: OutputFormat,
) -> None:
    """Print how the matches of a pattern or rule are found: the plan, with the rows of each step, and its source.

    Of an environment it says whether it is compiled, and else what keeps it from that.
    """
    from envgraph.cli._reasons import print_plan

    print_plan(model, definitions, name, where, inputs, format)


@app.command("why-not")
@model_or_run_argument
@definitions_argument
@click.argument("name", help="Name of a pattern, rule, unit or derived group.")
@where_option
@variant_option
@inputs_options
@format_option
def why_not(
    model: str,
    definitions: str,
    name: str,
    where: tuple[str, ...],
    inputs: Inputs,
    format: OutputFormat,
) -> None:
    """Print why a pattern or rule has no match, or a unit fails: how far it comes, and what is in the way."""
    from envgraph.cli._reasons import print_reasons

    print_reasons(model, definitions, name, where, inputs, format)


@app.command()
@model_or_run_argument
@click.argument("rules", metavar="RULESFILE", help="A .rules file.")
@click.argument("rule", help="Name of a rule, unit or derived group.")
@click.option(
    "--where",
    "-w",
    metavar="NAME=VALUE",
    multiple=True,
    help="Fix a variable of the match, or a parameter: an object by its name, or a value. What a unit needs and is "
    "not given is the only object of its class.",
)
@variant_option
@inputs_options
@count_option("--times", default=1, help="Number of applications; ends early when nothing matches.")
@count_option("--seed", least=0, help="Seed of the choice among matches.")
@click.option("--output", "-o", type=PATH, help="Write the resulting model here: .model, .xmi or .json.")
@click.option("--trace", type=PATH, help="Write what was applied here, for `envgraph replay`: JSON lines.")
@click.option("--allow-none", is_flag=True, help="Exit code 0 also when nothing matches or a unit fails.")
@format_option
def apply(
    model: str,
    rules: str,
    rule: str,
    where: tuple[str, ...],
    inputs: Inputs,
    times: int,
    seed: int,
    output: Path | None,
    trace: Path | None,
    allow_none: bool,
    format: OutputFormat,
) -> int:
    """Apply a rule to a model, at matches drawn at random, and print what was done. Exit code 1 if that is nothing."""
    from envgraph.cli._query import apply_rule

    applied = apply_rule(
        model,
        rules,
        rule,
        where,
        inputs=inputs,
        times=times,
        seed=seed,
        output=output,
        trace=trace,
        format=format,
    )
    return 0 if applied or allow_none else 1


@app.command()
@model_argument
@click.argument("rules", metavar="RULESFILE", help="A .rules file.")
@click.argument("trace", type=PATH, help="What `envgraph apply --trace` wrote.")
@inputs_options
@click.option("--output", "-o", type=PATH, help="Write the resulting model here: .model, .xmi or .json.")
@format_option
def replay(
    model: str,
    rules: str,
    trace: Path,
    inputs: Inputs,
    output: Path | None,
    format: OutputFormat,
) -> None:
    """Do again what a trace says, and compare each state with the recorded one. Exit code 1 where they differ."""
    from envgraph.cli._replay import replay_trace

    replay_trace(model, rules, trace, inputs=inputs, output=output, format=format)


@app.command()
@click.argument("file", help="A .metamodel or .ecore file; or a .model or .xmi file, or a model as JSON.")
@click.argument(
    "output", type=PATH, help="Where to: a metamodel as .ecore; a model as .model, .xmi or .json."
)
@inputs_options
@click.option("--lossy", is_flag=True, help="Write what can be kept, although warnings say what is lost.")
def convert(file: str, output: Path, inputs: Inputs, lossy: bool) -> None:
    """Write a metamodel or a model in a format of other tools: Ecore, XMI, JSON.

    Exit code 1 if something of it cannot be kept, which warnings say; then nothing is written.
    """
    from envgraph.cli._convert import convert_file

    convert_file(file, output, inputs, lossy=lossy)
