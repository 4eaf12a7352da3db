"""Declarations of the commands on files of a domain: names, arguments and options. Other modules implement them."""

from __future__ import annotations

import click

from envgraph.cli._app import app
from envgraph.cli._shared_options import (
    PATH,
    count_option,
    definitions_argument,
    format_option,
    implemented_in,
    inputs_options,
    model_argument,
    model_or_run_argument,
    overrides_option,
    variant_option,
    where_option,
)


@app.command()
@click.argument("name", help="Name of the domain: small letters, digits and `_`.")
@click.option("--directory", "-d", type=PATH, show_default="a directory of that name", help="Directory to write to.")
@click.option("--domain", help="Copy the files of this bundled domain instead.")
@implemented_in("_new_command", "new_domain")
def new() -> None:
    """Write a small domain to start from: a grid, a robot, rules, rewards, a family of mazes. Or copy a bundled one."""


@app.command()
@click.argument("environment", help="An id of Gymnasium, such as FrozenLake-v1.")
@click.option("--output", "-o", type=PATH, show_default="a directory of that name", help="Directory to write to.")
@click.option(
    "--set",
    "options",
    metavar="KEY=VALUE",
    multiple=True,
    help="An option of the environment, such as is_slippery=false; may be repeated.",
)
@count_option("--seed", minimum=0, default=0, help="Seed of the MiniGrid level.")
@format_option
@implemented_in("_adopt_command", "adopt_environment")
def adopt() -> None:
    """Write a domain that has the same transitions as a Gymnasium environment.

    The environment must expose its transition table, as FrozenLake does, or be a level of MiniGrid.
    """


@app.command()
@click.argument(
    "files",
    nargs=-1,
    required=True,
    help="Files of any of the languages, family files, directories, or bundled domains.",
)
@inputs_options
@click.option("--ignore", metavar="CODE", multiple=True, help="Omit warnings with this code; may be repeated.")
@click.option("--no-search", is_flag=True, help="Leave out the searches of families: `reachable` and measures.")
@overrides_option
@format_option
@implemented_in("_check_command", "check_files")
def check() -> None:
    """Read files and all their imports, and print all problems: position, line, hint. Exit code 1 on errors."""


@app.command("help")
@click.argument("names", nargs=-1, metavar="[NAME]...", help="Codes of errors and warnings, or names of commands.")
@format_option
@implemented_in("_help_command", "print_help")
def help_() -> None:
    """Explain a code of an error or warning: its meaning, its cure, an example. Without a name, list all codes."""


@app.command("format")
@click.argument(
    "files",
    nargs=-1,
    required=True,
    help="Files of any of the five languages, or directories of them; `-` is standard input.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Write nothing; list files that would change, with exit code 1 if there are any.",
)
@click.option("--stdout", is_flag=True, help="Print the formatted texts; do not change the files.")
@click.option("--language", help="Language of standard input: query, rules ...")
@click.option(
    "--derived",
    is_flag=True,
    help="Print the rules that `derive` statements in .rules files generate, instead of formatting.",
)
@implemented_in("_format_command", "format_files")
def format_() -> None:
    """Format files in the standard style: indentation, blanks, line ends. Comments stay. Skip files with errors."""


@app.command()
@implemented_in("_lsp_command", "serve_editor")
def lsp() -> None:
    """Serve a text editor over standard input and output, as a language server. Editors start this command."""


@app.command()
@model_or_run_argument
@click.argument("queries", metavar="QUERYFILE", help="A .query or .vql file.")
@click.argument(
    "pattern", required=False, help="Name of a pattern, simple or qualified. Without it, list the patterns."
)
@where_option
@variant_option
@inputs_options
@format_option
@implemented_in("_match_and_apply", "print_matches")
def match() -> None:
    """Print the matches of a pattern in a model, or list the patterns of a file."""


@app.command()
@model_or_run_argument
@definitions_argument
@click.argument("name", help="Name of a pattern, rule or environment.")
@where_option
@variant_option
@inputs_options
@format_option
@implemented_in("_explain_commands", "print_plan")
def explain() -> None:
    """Print how the matches of a pattern or rule are found: search plan, rows of each step, source code.

    For an environment, print whether it can be compiled; if not, print what prevents this.
    """


@app.command("why-not")
@model_or_run_argument
@definitions_argument
@click.argument("name", help="Name of a pattern, rule, unit or derived group.")
@where_option
@variant_option
@inputs_options
@format_option
@implemented_in("_explain_commands", "print_reasons")
def why_not() -> None:
    """Print why a pattern or rule has no match, or a unit fails: the best partial match and the failing constraint."""


@app.command()
@model_or_run_argument
@click.argument("rules", metavar="RULESFILE", help="A .rules file.")
@click.argument("rule", help="Name of a rule, unit or derived group.")
@click.option(
    "--where",
    "-w",
    metavar="NAME=VALUE",
    multiple=True,
    help="Fix a variable of the match, or a parameter: an object by its name, key or number, or a value. "
    "A parameter that a unit needs may be omitted if its class has only one object.",
)
@variant_option
@inputs_options
@count_option("--times", default=1, help="Number of applications; ends early when nothing matches.")
@count_option("--seed", minimum=0, help="Seed of the random choice of matches.")
@click.option("--output", "-o", type=PATH, help="File for the resulting model: .model, .xmi or .json.")
@click.option("--trace", type=PATH, help="File for the applications, for `envgraph replay`: JSON lines.")
@click.option("--allow-none", is_flag=True, help="Exit code 0 also when nothing matches or a unit fails.")
@format_option
@implemented_in("_match_and_apply", "apply_rule")
def apply() -> None:
    """Apply a rule to a model at randomly chosen matches, and print the changes. Exit code 1 if there are none."""


@app.command()
@model_argument
@click.argument("rules", metavar="RULESFILE", help="A .rules file.")
@click.argument("trace", type=PATH, help="A trace that `envgraph apply --trace` wrote.")
@inputs_options
@click.option("--output", "-o", type=PATH, help="File for the resulting model: .model, .xmi or .json.")
@format_option
@implemented_in("_replay_command", "replay_trace")
def replay() -> None:
    """Repeat the applications of a trace, and compare each state with the recorded one. Exit code 1 if any differs."""


@app.command()
@click.argument("file", help="A .metamodel or .ecore file; or a .model or .xmi file, or a model as JSON.")
@click.argument("output", type=PATH, help="File to write: .ecore for a metamodel; .model, .xmi or .json for a model.")
@inputs_options
@click.option("--lossy", is_flag=True, help="Write the file even if content is lost, as warnings say.")
@implemented_in("_convert_command", "convert_file")
def convert() -> None:
    """Write a metamodel or a model in a format of other tools: Ecore, XMI, JSON.

    If the format cannot hold all of the content, print warnings, write nothing, and exit with code 1.
    """
