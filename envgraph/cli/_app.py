"""The commands: what they are called and what they take. What they do is in the modules beside this one."""

from __future__ import annotations

import io
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated, Final, NoReturn

import typer

from envgraph import __version__
from envgraph.cli._output import OutputFormat, ShowFormat, error_to_dict, print_error, print_json, print_line
from envgraph.errors import EnvgraphError, InvalidArgument

app = typer.Typer(
    name="envgraph",
    help="Graph rewriting in Python, and families of reinforcement-learning environments made with it.",
    epilog="Begin with `envgraph new my_domain`, or with `envgraph generate burning_forest`.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _noted(context: typer.Context, format: OutputFormat | ShowFormat) -> OutputFormat | ShowFormat:
    """Tells `main` what errors are printed as."""
    context.find_root().obj.append(format.value)
    return format


Format = Annotated[
    OutputFormat,
    typer.Option(
        "--format",
        callback=_noted,
        help="How to print the result, and errors: for people, or as one JSON document.",
    ),
]
Run = Annotated[
    str,
    typer.Argument(
        help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json).",
        show_default=False,
    ),
]
Directory = Annotated[Path, typer.Option("--directory", "-d", help="Where runs are kept.")]
Seed = Annotated[
    int | None,
    typer.Option(
        min=0, help="The one source of randomness; instead of the one in the file.", show_default=False
    ),
]

Model = Annotated[
    str,
    typer.Argument(help="A .model or .xmi file, any model of EMF, or one as JSON.", show_default=False),
]
Metamodel = Annotated[
    list[str] | None,
    typer.Option(
        "--metamodel",
        "-m",
        help="A .ecore or .metamodel file; the other files may import it by its uri, or not at all. "
        "Several .ecore files, each with this option before it, become one metamodel.",
        show_default=False,
    ),
]
Unresolved = Annotated[
    bool,
    typer.Option(
        "--allow-unresolved",
        help="Leave links of EMF models to files and objects that are nowhere out, with a warning.",
    ),
]

Definitions = Annotated[
    str, typer.Argument(metavar="FILE", help="A .query, .vql or .rules file.", show_default=False)
]
Where = Annotated[
    list[str] | None,
    typer.Option(
        "--where", "-w", metavar="NAME=VALUE", help="Fix a parameter: an object by its name, or a value."
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Replace the run of that name, with its training and report, if there is one."
    ),
]

RUNS = Path("runs")

_INTERRUPTED: Final = 128 + signal.SIGINT
"""The exit code that Typer makes of KeyboardInterrupt."""


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
        app(prog_name="envgraph", obj=formats)
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
    except SystemExit as stop:
        if stop.code != _INTERRUPTED:
            raise
        sys.stderr.write("terminated\n" if ended else "interrupted\n")
        return 128 + ended[0] if ended else _INTERRUPTED
    finally:
        signal.signal(signal.SIGTERM, usual)
    return 0


def _version(wanted: bool) -> None:
    if wanted:
        print_line(f"envgraph {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    del version  # the callback has done its work


@app.command()
def new(
    name: Annotated[
        str, typer.Argument(help="Name of the domain: small letters, digits and `_`.", show_default=False)
    ],
    directory: Annotated[
        Path | None,
        typer.Option("--directory", "-d", help="Where to put it.", show_default="a directory of that name"),
    ] = None,
    domain: Annotated[
        str | None,
        typer.Option(help="Copy the files of this bundled domain instead.", show_default=False),
    ] = None,
) -> None:
    """Write a small domain to start from: a grid, a robot, rules, rewards, a family of mazes. Or copy a bundled one."""
    from envgraph.cli._new import copy_domain, write_domain

    place = directory or Path(name)
    files = write_domain(place, name) if domain is None else copy_domain(place, name, domain)
    for path in files:
        print_line(f"wrote {path}")
    has_family = any(path.name == "family.toml" for path in files)
    print_line(f"next: envgraph generate {place}" if has_family else f"next: envgraph check {files[0]}")


@app.command()
def check(
    files: Annotated[
        list[str],
        typer.Argument(
            help="Files of any of the languages, family files, directories, or bundled domains.",
            show_default=False,
        ),
    ],
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODE", help="Leave out warnings of this code; may be repeated.", show_default=False
        ),
    ] = None,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Read files and everything they import, and print all problems: position, line, hint. Exit code 1 on errors."""
    from envgraph.cli._check import check_files
    from envgraph.cli._inputs import Inputs

    raise typer.Exit(check_files(files, Inputs(metamodel or (), allow_unresolved), format, ignore or ()))


@app.command("format")
def format_(
    files: Annotated[
        list[str],
        typer.Argument(
            help="Files of any of the five languages, or directories of them; `-` is standard input.",
            show_default=False,
        ),
    ],
    check: Annotated[
        bool,
        typer.Option("--check", help="Write nothing; list what would change, exit code 1 if anything would."),
    ] = False,
    stdout: Annotated[
        bool, typer.Option("--stdout", help="Print the texts and leave the files alone.")
    ] = False,
    language: Annotated[
        str | None,
        typer.Option("--language", help="What standard input is: query, rules ...", show_default=False),
    ] = None,
    derived: Annotated[
        bool,
        typer.Option("--derived", help="Print the rules that `derive` stands for in .rules files instead."),
    ] = False,
) -> None:
    """Write files in the one style: indentation, blanks, line ends; comments stay. Files with errors are left alone."""
    from envgraph.cli._format import format_files, print_derived

    if derived:
        print_derived(files)
        return
    raise typer.Exit(format_files(files, check=check, stdout=stdout, language=language))


@app.command()
def match(
    model: Model,
    queries: Annotated[
        str, typer.Argument(metavar="QUERYFILE", help="A .query or .vql file.", show_default=False)
    ],
    pattern: Annotated[
        str, typer.Argument(help="Name of a pattern, simple or qualified.", show_default=False)
    ],
    where: Annotated[
        list[str] | None,
        typer.Option(
            "--where", "-w", metavar="NAME=VALUE", help="Fix a parameter: an object by its name, or a value."
        ),
    ] = None,
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Print the matches of a pattern in a model."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._query import print_matches

    print_matches(model, queries, pattern, where or [], Inputs(metamodel or (), allow_unresolved), format)


@app.command()
def explain(
    model: Model,
    definitions: Definitions,
    name: Annotated[str, typer.Argument(help="Name of a pattern or rule.", show_default=False)],
    where: Where = None,
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Print how the matches of a pattern or rule are found: the plan, with the rows of each step, and its source."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._reasons import print_plan

    print_plan(model, definitions, name, where or [], Inputs(metamodel or (), allow_unresolved), format)


@app.command("why-not")
def why_not(
    model: Model,
    definitions: Definitions,
    name: Annotated[
        str, typer.Argument(help="Name of a pattern, rule, unit or derived group.", show_default=False)
    ],
    where: Where = None,
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Print why a pattern or rule has no match, or a unit fails: how far it comes, and what is in the way."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._reasons import print_reasons

    print_reasons(model, definitions, name, where or [], Inputs(metamodel or (), allow_unresolved), format)


@app.command()
def apply(
    model: Model,
    rules: Annotated[str, typer.Argument(metavar="RULESFILE", help="A .rules file.", show_default=False)],
    rule: Annotated[str, typer.Argument(help="Name of a rule, unit or derived group.", show_default=False)],
    where: Annotated[
        list[str] | None,
        typer.Option(
            "--where",
            "-w",
            metavar="NAME=VALUE",
            help="Fix a variable of the match, or a parameter: an object by its name, or a value.",
        ),
    ] = None,
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    times: Annotated[int, typer.Option(min=1, help="How often; ends early when nothing matches.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Chooses among the matches.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Write the resulting model here: .model, .xmi or .json.",
            show_default=False,
        ),
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            "--trace",
            help="Write what was applied here, for `envgraph replay`: JSON lines.",
            show_default=False,
        ),
    ] = None,
    allow_none: Annotated[
        bool, typer.Option("--allow-none", help="Exit code 0 also when nothing matches or a unit fails.")
    ] = False,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Apply a rule to a model, at matches drawn at random, and print what was done. Exit code 1 if that is nothing."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._query import apply_rule

    applied = apply_rule(
        model,
        rules,
        rule,
        where or [],
        inputs=Inputs(metamodel or (), allow_unresolved),
        times=times,
        seed=seed,
        output=output,
        trace=trace,
        format=format,
    )
    raise typer.Exit(0 if applied or allow_none else 1)


@app.command()
def replay(
    model: Model,
    rules: Annotated[str, typer.Argument(metavar="RULESFILE", help="A .rules file.", show_default=False)],
    trace: Annotated[Path, typer.Argument(help="What `envgraph apply --trace` wrote.", show_default=False)],
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Write the resulting model here: .model, .xmi or .json.",
            show_default=False,
        ),
    ] = None,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Do again what a trace says, and compare each state with the recorded one. Exit code 1 where they differ."""
    from envgraph.cli._inputs import Inputs
    from envgraph.cli._replay import replay_trace

    inputs = Inputs(metamodel or (), allow_unresolved)
    replay_trace(model, rules, trace, inputs=inputs, output=output, format=format)


@app.command()
def convert(
    file: Annotated[
        str,
        typer.Argument(
            help="A .metamodel or .ecore file; or a .model or .xmi file, or a model as JSON.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Argument(
            help="Where to: a metamodel as .ecore; a model as .model, .xmi or .json.",
            show_default=False,
        ),
    ],
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    lossy: Annotated[
        bool, typer.Option("--lossy", help="Write what can be kept, although warnings say what is lost.")
    ] = False,
) -> None:
    """Write a metamodel or a model in a format of other tools: Ecore, XMI, JSON.

    Exit code 1 if something of it cannot be kept, which warnings say; then nothing is written.
    """
    from envgraph.cli._convert import convert_file
    from envgraph.cli._inputs import Inputs

    convert_file(file, output, Inputs(metamodel or (), allow_unresolved), lossy=lossy)


@app.command()
def generate(
    family: Annotated[
        str,
        typer.Argument(
            help="A family.toml, a directory with one, or the name of a bundled domain.", show_default=False
        ),
    ],
    name: Annotated[
        str | None, typer.Option(help="Name of the run.", show_default="that of the family")
    ] = None,
    seed: Seed = None,
    generations: Annotated[
        int | None, typer.Option(min=0, help="Instead of the number in the file.", show_default=False)
    ] = None,
    population: Annotated[
        int | None, typer.Option(min=2, help="Instead of the size in the file.", show_default=False)
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Instead of what the file says: any key of it, such as search.population=10.",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Go on with a run that was interrupted, or, with a larger --generations, one that has ended.",
        ),
    ] = False,
    force: Force = False,
    directory: Directory = RUNS,
    format: Format = OutputFormat.TEXT,
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
        family, name=name, overrides=[*short, *(overrides or ())], generations=generations,
        resume=resume, force=force, directory=directory, format=format,
    )  # fmt: skip


@app.command("runs")
def runs_(directory: Directory = RUNS, format: Format = OutputFormat.TEXT) -> None:
    """List the runs that there are."""
    from envgraph.cli._runs import list_runs

    list_runs(directory, format)


@app.command()
def show(
    run: Annotated[
        str,
        typer.Argument(
            help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json), a model "
            "(.model, .xmi) or a metamodel (.metamodel, .ecore).",
            show_default=False,
        ),
    ],
    variant: Annotated[
        str | None, typer.Option(help="Only this environment: its name (E6) or number.", show_default=False)
    ] = None,
    directory: Directory = RUNS,
    metamodel: Metamodel = None,
    allow_unresolved: Unresolved = False,
    format: Annotated[
        ShowFormat,
        typer.Option(
            "--format",
            callback=_noted,
            help="text or json; models and metamodels also as a picture: dot or svg.",
        ),
    ] = ShowFormat.TEXT,
) -> None:
    """Print a family: its measures and its maps. Or a model or a metamodel: what is in it, or a picture of it."""
    from envgraph.cli._inputs import DEFINITIONS, METAMODELS, MODELS, Inputs
    from envgraph.cli._picture import show_file
    from envgraph.lang import DiskFiles, file_format

    shown = file_format(DiskFiles(), run)
    if shown in (*MODELS, *METAMODELS):
        show_file(run, variant, Inputs(metamodel or (), allow_unresolved), format)
        return
    if shown in DEFINITIONS:
        raise InvalidArgument(f"`{run}` is no run, model or metamodel; `envgraph check {run}` reads it")
    from envgraph.cli._family import show_family

    if format in (ShowFormat.DOT, ShowFormat.SVG):
        raise InvalidArgument(
            f"`envgraph export {run} --format svg` draws a run; `show` draws models and metamodels"
        )
    show_family(run, directory, variant, OutputFormat(format.value))


@app.command()
def export(
    run: Run,
    format: Annotated[
        str,
        typer.Option(
            "--format", help="family (all there is, as JSON), ga4cl (maps of letters) or svg (a picture)."
        ),
    ] = "family",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Where to.", show_default="standard output")
    ] = None,
    directory: Directory = RUNS,
) -> None:
    """Write a family in another format."""
    from envgraph.cli._family import export_family

    export_family(run, directory, format, output)


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(help="A ga4cl file: maps as rows of letters.", show_default=False)],
    domain: Annotated[
        str,
        typer.Option(help="What else an environment is: a family.toml, its directory, or a bundled domain."),
    ] = "burning_forest",
    name: Annotated[
        str | None, typer.Option(help="Name of the run.", show_default="that of the file")
    ] = None,
    force: Force = False,
    directory: Directory = RUNS,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Read a published family, measure it, and keep it as a run."""
    from envgraph.cli._family import import_family

    import_family(file, domain, name, directory, force, format)


@app.command()
def train(
    run: Run,
    steps: Annotated[
        str | None,
        typer.Option(
            help="Training steps for each environment; several budgets are separated by commas. "
            "A baseline gets as many steps as the whole family together.",
            show_default="as in family.toml",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, help="How many agents for each curriculum.", show_default="as in family.toml"),
    ] = None,
    curricula: Annotated[
        str | None,
        typer.Option(
            help="Some of suffixes (E1-E6, E2-E6 ...), full (E1-E6), baselines (each environment alone) and direct "
            "(the target alone), separated by commas. With a curriculum among them, agents are also trained on the "
            "family up to each environment, and evaluated there.",
            show_default="as in family.toml, and the baselines",
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="How many agents learn at a time; changes no result.")
    ] = 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a training that was interrupted.")
    ] = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            help="Replace results of as many steps, or a training that was interrupted, if there are any.",
        ),
    ] = False,
    directory: Directory = RUNS,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Train agents on curricula and on single environments, and evaluate them on the target."""
    from envgraph.cli._learn import train_agents

    train_agents(
        run,
        directory,
        steps=steps,
        seeds=seeds,
        curricula=curricula,
        workers=workers,
        resume=resume,
        force=force,
        format=format,
    )


@app.command()
def report(
    run: Run,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Where to.", show_default="report.html in the run")
    ] = None,
    directory: Directory = RUNS,
    format: Format = OutputFormat.TEXT,
) -> None:
    """Write one self-contained HTML page: the family, the search, the training; and print a short table."""
    from envgraph.cli._learn import write_report

    write_report(run, directory, output, format)
