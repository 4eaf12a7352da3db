"""The commands: what they are called and what they take. What they do is in the modules beside this one."""

from __future__ import annotations

import io
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

import click

from envgraph import __version__
from envgraph.cli._output import OutputFormat, ShowFormat, error_to_dict, print_error, print_json, print_line
from envgraph.errors import EnvgraphError, InvalidArgument

RUNS = Path("runs")

_INTERRUPTED: Final = 128 + signal.SIGINT
_PATH: Final = click.Path(path_type=Path)


class _Commands(click.Group):
    """The commands in the order of this file; what they return is the exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """See `Group`."""
        return list(self.commands)

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """See `Group`; the list of commands shows whole first paragraphs."""
        cmd.short_help = (cmd.help or "").partition("\n\n")[0]
        super().add_command(cmd, name)

    def invoke(self, ctx: click.Context) -> Any:
        """See `Group`; an interruption is an exit code, too."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            return _INTERRUPTED


@click.group(
    name="envgraph",
    cls=_Commands,
    help="Graph rewriting in Python, and families of reinforcement-learning environments made with it.",
    epilog="Begin with `envgraph new my_domain`, or with `envgraph generate burning_forest`.",
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, message="envgraph %(version)s", help="Print the version and stop.")
def app() -> None:
    """See `help`."""


def main() -> int:
    """The program `envgraph`: 0 when all went well, 1 for a problem of the input, 2 for one of the command line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that cannot show a letter of a file shows its number.
            stream.reconfigure(errors="backslashreplace")
    if sys.stdout is None or sys.stderr is None:  # closed by the caller: `envgraph show a >&-`
        sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, until the end
        sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    ended: list[int] = []
    formats: list[str] = []

    def end(number: int, frame: FrameType | None) -> NoReturn:
        ended.append(number)
        raise KeyboardInterrupt  # what Ctrl-C saves and says is saved and said

    usual = signal.signal(signal.SIGTERM, end)
    try:
        code = app.main(prog_name="envgraph", obj=formats, standalone_mode=False) or 0
    except (EnvgraphError, OSError) as error:
        if isinstance(error, BrokenPipeError):
            # The reader has what it wanted (`envgraph ... | head`); Python must not complain at shutdown either.
            sys.stderr.close()
            return 0
        if formats[-1:] == ["json"]:
            print_json(error_to_dict(error))
        else:
            print_error(error)
        return 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:  # interrupted before the command began
        code = _INTERRUPTED
    finally:
        signal.signal(signal.SIGTERM, usual)
    if code == _INTERRUPTED:
        sys.stderr.write("terminated\n" if ended else "interrupted\n")
        return 128 + ended[0] if ended else _INTERRUPTED
    assert isinstance(code, int)
    return code


def _noted(
    context: click.Context, parameter: click.Parameter, format: OutputFormat | ShowFormat
) -> OutputFormat | ShowFormat:
    """Tells `main` what errors are printed as."""
    context.find_root().obj.append(format.value)
    return format


_format = click.option(
    "--format",
    type=click.Choice(OutputFormat, case_sensitive=False),
    default=OutputFormat.TEXT.value,
    callback=_noted,
    help="How to print the result, and errors: for people, or as one JSON document.",
)
_run = click.argument(
    "run", help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json)."
)
_directory = click.option("--directory", "-d", type=_PATH, default=RUNS, help="Where runs are kept.")
_seed = click.option(
    "--seed", type=click.IntRange(min=0), help="The one source of randomness; instead of the one in the file."
)
_model = click.argument("model", help="A .model or .xmi file, any model of EMF, or one as JSON.")
_model_or_run = click.argument(
    "model",
    help="A .model or .xmi file, any model of EMF, or one as JSON; with --variant a run or a family file (.json).",
)
_variant = click.option(
    "--variant", help="Only this environment of a run or family: its name (E6) or number."
)
_metamodel = click.option(
    "--metamodel",
    "-m",
    multiple=True,
    help="A .ecore or .metamodel file; the other files may import it by its uri, or not at all. "
    "Several .ecore files, each with this option before it, become one metamodel.",
)
_unresolved = click.option(
    "--allow-unresolved",
    is_flag=True,
    help="Leave links of EMF models to files and objects that are nowhere out, with a warning.",
)
_definitions = click.argument("definitions", metavar="FILE", help="A .query, .vql or .rules file.")
_where = click.option(
    "--where",
    "-w",
    metavar="NAME=VALUE",
    multiple=True,
    help="Fix a parameter: an object by its name, or a value.",
)
_force = click.option(
    "--force",
    is_flag=True,
    help="Replace the run of that name, with its training and report, if there is one.",
)


@app.command()
@click.argument("name", help="Name of the domain: small letters, digits and `_`.")
@click.option(
    "--directory", "-d", type=_PATH, show_default="a directory of that name", help="Where to put it."
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
@click.argument(
    "files",
    nargs=-1,
    required=True,
    help="Files of any of the languages, family files, directories, or bundled domains.",
)
@_metamodel
@_unresolved
@click.option(
    "--ignore", metavar="CODE", multiple=True, help="Leave out warnings of this code; may be repeated."
)
@_format
def check(
    files: tuple[str, ...],
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    ignore: tuple[str, ...],
    format: OutputFormat,
) -> int:
    """Read files and everything they import, and print all problems: position, line, hint. Exit code 1 on errors."""
    from envgraph.cli._check import check_files
    from envgraph.cli._inputs import Inputs

    return check_files(files, Inputs(metamodel, allow_unresolved), format, ignore)


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
@_model_or_run
@click.argument("queries", metavar="QUERYFILE", help="A .query or .vql file.")
@click.argument("pattern", help="Name of a pattern, simple or qualified.")
@click.option(
    "--where",
    "-w",
    metavar="NAME=VALUE",
    multiple=True,
    help="Fix a parameter: an object by its name, or a value.",
)
@_variant
@_metamodel
@_unresolved
@_format
def match(
    model: str,
    queries: str,
    pattern: str,
    where: tuple[str, ...],
    variant: str | None,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    format: OutputFormat,
) -> None:
    """Print the matches of a pattern in a model."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._query import print_matches

    print_matches(model, queries, pattern, where, Inputs(metamodel, allow_unresolved, variant), format)


@app.command()
@_model_or_run
@_definitions
@click.argument("name", help="Name of a pattern, rule or environment.")
@_where
@_variant
@_metamodel
@_unresolved
@_format
def explain(
    model: str,
    definitions: str,
    name: str,
    where: tuple[str, ...],
    variant: str | None,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    format: OutputFormat,
) -> None:
    """Print how the matches of a pattern or rule are found: the plan, with the rows of each step, and its source.

    Of an environment it says whether it is compiled, and else what keeps it from that.
    """
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._reasons import print_plan

    print_plan(model, definitions, name, where, Inputs(metamodel, allow_unresolved, variant), format)


@app.command("why-not")
@_model_or_run
@_definitions
@click.argument("name", help="Name of a pattern, rule, unit or derived group.")
@_where
@_variant
@_metamodel
@_unresolved
@_format
def why_not(
    model: str,
    definitions: str,
    name: str,
    where: tuple[str, ...],
    variant: str | None,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    format: OutputFormat,
) -> None:
    """Print why a pattern or rule has no match, or a unit fails: how far it comes, and what is in the way."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._reasons import print_reasons

    print_reasons(model, definitions, name, where, Inputs(metamodel, allow_unresolved, variant), format)


@app.command()
@_model_or_run
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
@_variant
@_metamodel
@_unresolved
@click.option(
    "--times", type=click.IntRange(min=1), default=1, help="How often; ends early when nothing matches."
)
@click.option("--seed", type=click.IntRange(min=0), help="Chooses among the matches.")
@click.option("--output", "-o", type=_PATH, help="Write the resulting model here: .model, .xmi or .json.")
@click.option("--trace", type=_PATH, help="Write what was applied here, for `envgraph replay`: JSON lines.")
@click.option("--allow-none", is_flag=True, help="Exit code 0 also when nothing matches or a unit fails.")
@_format
def apply(
    model: str,
    rules: str,
    rule: str,
    where: tuple[str, ...],
    variant: str | None,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    times: int,
    seed: int,
    output: Path | None,
    trace: Path | None,
    allow_none: bool,
    format: OutputFormat,
) -> int:
    """Apply a rule to a model, at matches drawn at random, and print what was done. Exit code 1 if that is nothing."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._query import apply_rule

    applied = apply_rule(
        model,
        rules,
        rule,
        where,
        inputs=Inputs(metamodel, allow_unresolved, variant),
        times=times,
        seed=seed,
        output=output,
        trace=trace,
        format=format,
    )
    return 0 if applied or allow_none else 1


@app.command()
@_model
@click.argument("rules", metavar="RULESFILE", help="A .rules file.")
@click.argument("trace", type=_PATH, help="What `envgraph apply --trace` wrote.")
@_metamodel
@_unresolved
@click.option("--output", "-o", type=_PATH, help="Write the resulting model here: .model, .xmi or .json.")
@_format
def replay(
    model: str,
    rules: str,
    trace: Path,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    output: Path | None,
    format: OutputFormat,
) -> None:
    """Do again what a trace says, and compare each state with the recorded one. Exit code 1 where they differ."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._replay import replay_trace

    inputs = Inputs(metamodel, allow_unresolved)
    replay_trace(model, rules, trace, inputs=inputs, output=output, format=format)


@app.command()
@click.argument("file", help="A .metamodel or .ecore file; or a .model or .xmi file, or a model as JSON.")
@click.argument(
    "output", type=_PATH, help="Where to: a metamodel as .ecore; a model as .model, .xmi or .json."
)
@_metamodel
@_unresolved
@click.option("--lossy", is_flag=True, help="Write what can be kept, although warnings say what is lost.")
def convert(file: str, output: Path, metamodel: tuple[str, ...], allow_unresolved: bool, lossy: bool) -> None:
    """Write a metamodel or a model in a format of other tools: Ecore, XMI, JSON.

    Exit code 1 if something of it cannot be kept, which warnings say; then nothing is written.
    """
    from envgraph.cli._convert import convert_file
    from envgraph.cli._inputs import Inputs

    convert_file(file, output, Inputs(metamodel, allow_unresolved), lossy=lossy)


@app.command()
@click.argument("family", help="A family.toml, a directory with one, or the name of a bundled domain.")
@click.option("--name", show_default="that of the family", help="Name of the run.")
@_seed
@click.option("--generations", type=click.IntRange(min=0), help="Instead of the number in the file.")
@click.option("--population", type=click.IntRange(min=1), help="Instead of the size in the file.")
@click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Instead of what the file says: any key of it, such as search.population=10.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with a run that was interrupted, or, with a larger --generations, one that has ended.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    help="How many threads train the learners of an objective; changes no result.",
)
@_force
@_directory
@_format
def generate(
    family: str,
    name: str | None,
    seed: int | None,
    generations: int | None,
    population: int | None,
    overrides: tuple[str, ...],
    resume: bool,
    workers: int,
    force: bool,
    directory: Path,
    format: OutputFormat,
) -> None:
    """Evolve a family of environments from one model."""
    from envgraph.cli._family import generate_family

    if resume and (seed is not None or population is not None or overrides or force):
        raise InvalidArgument(
            "a resumed run keeps what it began with, but for --generations: leave the others out"
        )
    given = {"seed": seed, "search.generations": generations, "search.population": population}
    short = [] if resume else [f"{key}={value}" for key, value in given.items() if value is not None]
    generate_family(
        family, name=name, overrides=[*short, *overrides], generations=generations,
        resume=resume, force=force, directory=directory, format=format, workers=workers,
    )  # fmt: skip


@app.command()
@click.argument(
    "problem", help="A family file with [optimise], a directory with a problem.toml, or a bundled domain."
)
@_seed
@click.option("--steps", type=click.IntRange(min=1), help="How many moves are tried.")
@click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Instead of what the file says: any key of it, such as optimise.strategy=beam.",
)
@click.option(
    "--solution",
    type=click.IntRange(min=1),
    default=1,
    help="Which one of a front is written, by its number.",
)
@click.option("--output", "-o", type=_PATH, help="Write the best model here: .model, .xmi or .json.")
@click.option(
    "--trace", type=_PATH, help="Write the rules that lead to it here, for `envgraph replay`: JSON lines."
)
@click.option("--picture", type=_PATH, help="Draw the front of the first two objectives here, as SVG.")
@_format
def optimise(
    problem: str,
    seed: int | None,
    steps: int | None,
    overrides: tuple[str, ...],
    solution: int,
    output: Path | None,
    trace: Path | None,
    picture: Path | None,
    format: OutputFormat,
) -> int:
    """Find the model that is best by some queries, by applying rules. Exit code 1 if it violates a constraint."""
    from envgraph.cli._optimise import optimise_model

    given = {"seed": seed, "optimise.steps": steps}
    short = [f"{key}={value}" for key, value in given.items() if value is not None]
    return optimise_model(
        problem, overrides=[*short, *overrides], solution=solution, output=output, trace=trace, picture=picture,
        format=format,
    )  # fmt: skip


@app.command("verify")
@click.argument(
    "run", help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json)."
)
@_directory
@_format
def verify_(run: str, directory: Path, format: OutputFormat) -> None:
    """Print what is certain of each environment of a family, computed twice by different means.

    The fewest steps to success, how likely a random walk succeeds, and the optimal return. Exit code 1 where the two
    differ.
    """
    from envgraph.cli._verify import verify_family

    verify_family(run, directory, format)


@app.command("runs")
@_directory
@_format
def runs_(directory: Path, format: OutputFormat) -> None:
    """List the runs that there are."""
    from envgraph.cli._runs import list_runs

    list_runs(directory, format)


@app.command()
@click.argument(
    "run",
    help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json), a model "
    "(.model, .xmi) or a metamodel (.metamodel, .ecore).",
)
@_variant
@click.option(
    "--lineage", metavar="VARIANT", help="The rules that made this environment of a run, and where."
)
@click.option("--rejections", is_flag=True, help="Why models were turned down in a run, and how often.")
@_directory
@_metamodel
@_unresolved
@click.option(
    "--format",
    type=click.Choice(ShowFormat, case_sensitive=False),
    default=ShowFormat.TEXT.value,
    callback=_noted,
    help="text or json; models and metamodels also as a picture: dot or svg.",
)
def show(
    run: str,
    variant: str | None,
    lineage: str | None,
    rejections: bool,
    directory: Path,
    metamodel: tuple[str, ...],
    allow_unresolved: bool,
    format: ShowFormat,
) -> None:
    """Print a family: its measures and its maps. Or a model or a metamodel: what is in it, or a picture of it."""
    from envgraph.cli._inputs import DEFINITIONS, METAMODELS, MODELS, Inputs
    from envgraph.cli._picture import show_file
    from envgraph.lang import DiskFiles, file_format

    shown = file_format(DiskFiles(), run)
    if shown in (*MODELS, *METAMODELS):
        show_file(run, variant, Inputs(metamodel, allow_unresolved), format)
        return
    if shown in DEFINITIONS:
        raise InvalidArgument(f"`{run}` is no run, model or metamodel; `envgraph check {run}` reads it")
    from envgraph.cli._family import show_family, show_lineage, show_rejections

    if format in (ShowFormat.DOT, ShowFormat.SVG):
        raise InvalidArgument(
            f"`envgraph export {run} --format svg` draws a run; `show` draws models and metamodels"
        )
    if lineage is not None:
        show_lineage(run, directory, lineage, OutputFormat(format.value))
    elif rejections:
        show_rejections(run, directory, OutputFormat(format.value))
    else:
        show_family(run, directory, variant, OutputFormat(format.value))


@app.command()
@_run
@click.option(
    "--format",
    default="family",
    help="family (all there is, as JSON), ga4cl (maps of letters), svg (a picture) or compiled (a folder with a Python "
    "package that steps the environments, and needs NumPy and numba alone).",
)
@click.option("--output", "-o", type=_PATH, show_default="standard output", help="Where to.")
@_directory
def export(run: str, format: str, output: Path | None, directory: Path) -> None:
    """Write a family in another format."""
    from envgraph.cli._family import export_family

    export_family(run, directory, format, output)


@app.command("import")
@click.argument("file", type=_PATH, help="A ga4cl file: maps as rows of letters.")
@click.option(
    "--domain",
    default="burning_forest",
    help="What else an environment is: a family.toml, its directory, or a bundled domain.",
)
@click.option("--name", show_default="that of the file", help="Name of the run.")
@_force
@_directory
@_format
def import_(
    file: Path, domain: str, name: str | None, force: bool, directory: Path, format: OutputFormat
) -> None:
    """Read a published family, measure it, and keep it as a run."""
    from envgraph.cli._family import import_family

    import_family(file, domain, name, directory, force, format)


@app.command()
@_run
@click.option(
    "--steps",
    show_default="as in family.toml",
    help="Training steps for each environment; several budgets are separated by commas. "
    "A baseline gets as many steps as the whole family together.",
)
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    show_default="as in family.toml",
    help="How many agents for each curriculum.",
)
@click.option(
    "--curricula",
    show_default="as in family.toml, and the baselines",
    help="Some of suffixes (E1-E6, E2-E6 ...), full (E1-E6), baselines (each environment alone) and direct "
    "(the target alone), separated by commas. With a curriculum among them, agents are also trained on the "
    "family up to each environment, and evaluated there.",
)
@click.option(
    "--controls",
    show_default="all but random, where there is a curriculum",
    help="What the curriculum is compared with, each with as many steps: some of direct (the target alone), optimistic "
    "(likewise, with higher values at first), reversed, shuffled (other orders, the target last), randomised (an "
    "environment drawn for each episode) and random (families that nothing has selected, one a seed), separated by "
    "commas; or all, or none.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    help="How many agents learn at a time; changes no result.",
)
@click.option("--resume", is_flag=True, help="Go on with a training that was interrupted.")
@click.option(
    "--force",
    is_flag=True,
    help="Replace results of as many steps, or a training that was interrupted, if there are any.",
)
@_directory
@_format
def train(
    run: str,
    steps: str | None,
    seeds: int | None,
    curricula: str | None,
    controls: str | None,
    workers: int,
    resume: bool,
    force: bool,
    directory: Path,
    format: OutputFormat,
) -> None:
    """Train agents on curricula, single environments and controls, and evaluate them on the target."""
    from envgraph.cli._learn import train_agents

    train_agents(
        run,
        directory,
        steps=steps,
        seeds=seeds,
        curricula=curricula,
        controls=controls,
        workers=workers,
        resume=resume,
        force=force,
        format=format,
    )


@app.command()
@_run
@click.option("--output", "-o", type=_PATH, show_default="report.html in the run", help="Where to.")
@_directory
@_format
def report(run: str, output: Path | None, directory: Path, format: OutputFormat) -> None:
    """Write one self-contained HTML page: the family, the search, the training; and print a short table."""
    from envgraph.cli._learn import write_report

    write_report(run, directory, output, format)


@app.command()
@click.argument("what", metavar="paper")
@click.option(
    "--output", "-o", type=_PATH, default=Path("reproduction"), help="The directory of what is written."
)
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=200,
    help="How many agents for each curriculum, and how many families of our own.",
)
@click.option(
    "--steps",
    default="10000,50000,100000",
    help="Training steps for each environment; several budgets are separated by commas.",
)
@click.option(
    "--times/--no-times", default=True, help="Whether to measure how long generation takes (table 4)."
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    help="How many agents learn at a time; changes no result.",
)
@click.option("--force", is_flag=True, help="Replace what an earlier one has written.")
@_format
def reproduce(
    what: str,
    output: Path,
    seeds: int,
    steps: str,
    times: bool,
    workers: int,
    force: bool,
    format: OutputFormat,
) -> None:
    """Make the paper's experiments again, with many seeds and controls: which of its claims hold.

    Writes a page, its tables as CSV and its charts as SVG.
    """
    from envgraph.cli._reproduce import reproduce_paper

    reproduce_paper(
        what,
        output,
        seeds=seeds,
        steps=steps,
        times=times,
        workers=workers,
        force=force,
        format=format,
    )


@app.command()
@click.argument(
    "families",
    nargs=-1,
    required=True,
    help="A family file with `[audit]`, a directory with an audit.toml, or the name of a bundled domain; several are "
    "judged apart and together.",
)
@click.option(
    "--seeds",
    type=click.IntRange(min=2),
    show_default="as in the file",
    help="Students of each decisive method.",
)
@click.option(
    "--controls",
    type=click.IntRange(min=2),
    show_default="as in the file",
    help="Students of each other method, no more than --seeds.",
)
@click.option(
    "--steps",
    type=click.IntRange(min=8 * 4096),
    show_default="as in the file",
    help="Steps of each student, with all that it costs to score levels.",
)
@click.option("--methods", show_default="all", help="Some methods by their names, separated by semicolons.")
@click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Instead of what the file says, as in `generate`.",
)
@click.option(
    "--workers",
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    help="How many students learn at a time; changes no result.",
)
@click.option("--force", is_flag=True, help="Replace an audit of other files or with other settings.")
@click.option("--directory", "-d", type=_PATH, default=Path("audits"), help="Where audits are kept.")
@_format
def audit(
    families: tuple[str, ...],
    seeds: int | None,
    controls: int | None,
    steps: int | None,
    methods: str | None,
    overrides: tuple[str, ...],
    workers: int,
    force: bool,
    directory: Path,
    format: OutputFormat,
) -> None:
    """Say what the scores by which curricula choose levels rank, teach and cost, beside exact regret and learnability.

    An audit that was interrupted goes on where it was. Writes audit.html, its figures, and tables as CSV.
    """
    from envgraph.cli._audit import audit_scores

    audit_scores(
        families,
        directory,
        seeds=seeds,
        controls=controls,
        steps=steps,
        methods=methods,
        workers=workers,
        force=force,
        overrides=overrides,
        format=format,
    )
