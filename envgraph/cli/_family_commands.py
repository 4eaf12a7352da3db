"""Commands on families and problems: what they are called and what they take. What they do is in other modules."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from envgraph.cli._app import app
from envgraph.cli._options import (
    PATH,
    count_option,
    directory_option,
    force_option,
    format_option,
    metamodel_option,
    noted,
    overrides_option,
    run_argument,
    seed_option,
    unresolved_option,
    variant_option,
)
from envgraph.cli._output import OutputFormat, ShowFormat, printed_to
from envgraph.errors import InvalidArgument


@app.command()
@click.argument("family", help="A family.toml, a directory with one, or the name of a bundled domain.")
@click.option("--name", show_default="that of the family", help="Name of the run.")
@seed_option
@count_option("--generations", least=0, help="Instead of the number in the file.")
@count_option("--population", help="Instead of the size in the file.")
@count_option(
    "--samples",
    least=2,
    help="Draw so many environments, all valid and no two the same, instead of searching for a family.",
)
@overrides_option
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with a run that was interrupted, or, with a larger --generations, one that has ended.",
)
@count_option(
    "--workers", default=1, help="How many threads train the learners of an objective; changes no result."
)
@click.option(
    "--require",
    type=float,
    metavar="VALUE",
    help="Exit with code 1 if the family has a lower value: share of learners that solve the target, or diversity.",
)
@force_option
@directory_option
@format_option
def generate(
    family: str,
    name: str | None,
    seed: int | None,
    generations: int | None,
    population: int | None,
    samples: int | None,
    overrides: tuple[str, ...],
    resume: bool,
    workers: int,
    require: float | None,
    force: bool,
    directory: Path,
    format: OutputFormat,
) -> None:
    """Make a family of environments out of one model."""
    from envgraph.cli._family import generate_family

    given = {
        "seed": seed,
        "search.generations": generations,
        "search.population": population,
        "samples.count": samples,
    }
    short = [f"{key}={value}" for key, value in given.items() if value is not None]
    if resume and (len(short) > (generations is not None) or overrides or force):
        raise InvalidArgument(
            "a resumed run keeps what it began with, but for --generations: leave the others out"
        )
    generate_family(
        family, name=name, overrides=[] if resume else [*short, *overrides], generations=generations,
        resume=resume, force=force, directory=directory, format=format, workers=workers, require=require,
    )  # fmt: skip


@app.command()
@click.argument(
    "problem", help="A family file with [optimise], a directory with a problem.toml, or a bundled domain."
)
@seed_option
@count_option("--steps", help="How many moves are tried.")
@overrides_option
@count_option("--solution", default=1, help="Which one of a front is written, by its number.")
@click.option("--output", "-o", type=PATH, help="Write the best model here: .model, .xmi or .json.")
@click.option(
    "--trace", type=PATH, help="Write the rules that lead to it here, for `envgraph replay`: JSON lines."
)
@click.option("--picture", type=PATH, help="Draw the front of the first two objectives here, as SVG.")
@format_option
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
@run_argument
@click.option("--resume", is_flag=True, help="Leave out what was verified before, as after an interruption.")
@directory_option
@format_option
def verify_(run: str, resume: bool, directory: Path, format: OutputFormat) -> None:
    """Print what is certain of each environment of a family, computed twice by different means.

    The fewest steps to success, how likely a random walk succeeds, and the optimal return. Exit code 1 where the two
    differ. A run keeps what was verified, environment by environment.
    """
    from envgraph.cli._verify import verify_family
    from envgraph.search import RunStore, run_file

    is_file = run.endswith(".json")
    with nullcontext() if is_file else RunStore.open(run_file(run, directory), writing=True) as store:
        verify_family(run, directory, format, store, resume=resume)


@app.command("runs")
@click.argument("compared", nargs=-1, metavar="[RUN OTHER]", help="Two runs: what differs between them.")
@directory_option
@format_option
def runs_(compared: tuple[str, ...], directory: Path, format: OutputFormat) -> None:
    """List the runs that there are, or what differs between two of them: settings, texts, figures and members."""
    from envgraph.cli._runs import compare_runs, list_runs

    if not compared:
        list_runs(directory, format)
    elif len(compared) == 2:
        compare_runs(*compared, directory, format)
    else:
        raise InvalidArgument("two runs are compared", "name both; without any all are listed")


@app.command()
@click.argument(
    "run",
    help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json), a model "
    "(.model, .xmi) or a metamodel (.metamodel, .ecore).",
)
@variant_option
@click.option(
    "--lineage", metavar="VARIANT", help="The rules that made this environment of a run, and where."
)
@click.option("--rejections", is_flag=True, help="Why models were turned down in a run, and how often.")
@directory_option
@metamodel_option
@unresolved_option
@click.option(
    "--format",
    type=click.Choice(ShowFormat, case_sensitive=False),
    default=ShowFormat.TEXT.value,
    callback=noted,
    help="text or json; models and metamodels also as a picture: dot or svg.",
)
@click.option(
    "--output",
    "-o",
    type=PATH,
    show_default="standard output",
    help="Where to; .json, .dot and .svg say the format, too.",
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
    output: Path | None,
) -> None:
    """Print a family: its measures and its maps. Or a model or a metamodel: what is in it, or a picture of it."""
    from envgraph.cli._inputs import DEFINITIONS, METAMODELS, MODELS, Inputs
    from envgraph.cli._picture import show_file
    from envgraph.lang import DiskFiles, file_format

    if output is not None and format is ShowFormat.TEXT and output.suffix[1:] in list(ShowFormat):
        format = ShowFormat(output.suffix[1:])
    shown = file_format(DiskFiles(), run)
    if shown in (*MODELS, *METAMODELS):
        with printed_to(output):
            show_file(run, variant, Inputs(metamodel, allow_unresolved), format)
        return
    if shown in DEFINITIONS:
        raise InvalidArgument(f"`{run}` is no run, model or metamodel; `envgraph check {run}` reads it")
    from envgraph.cli._family import show_family, show_lineage, show_rejections

    if format in (ShowFormat.DOT, ShowFormat.SVG):
        raise InvalidArgument(
            f"`envgraph export {run} --format svg` draws a run; `show` draws models and metamodels"
        )
    with printed_to(output):
        if lineage is not None:
            show_lineage(run, directory, lineage, OutputFormat(format.value))
        elif rejections:
            show_rejections(run, directory, OutputFormat(format.value))
        else:
            show_family(run, directory, variant, OutputFormat(format.value))


@app.command()
@run_argument
@click.option(
    "--format",
    "--to",
    "format",
    default="family",
    help="family (all there is, as JSON), ga4cl (maps of letters), frozenlake (maps of Gymnasium's FrozenLake, where "
    "they step the same), minigrid (levels, of a domain that was adopted from MiniGrid), svg (a picture), npz (the "
    "tables of states, as arrays of NumPy), python (a package to install that needs Gymnasium and NumPy alone) or "
    "compiled (a package that steps many environments at once, and needs NumPy and numba alone).",
)
@click.option("--output", "-o", type=PATH, show_default="standard output", help="Where to.")
@click.option(
    "--templates",
    type=PATH,
    metavar="DIR",
    help="Templates for --format python, instead of those of `envgraph templates`.",
)
@directory_option
def export(run: str, format: str, output: Path | None, templates: Path | None, directory: Path) -> None:
    """Write a family in another format."""
    from envgraph.cli._export import export_family

    export_family(run, directory, format, output, templates)


@app.command("templates")
@click.argument("folder", type=PATH, help="Where to; there must be nothing in it.")
def templates_(folder: Path) -> None:
    """Write the templates of `envgraph export --format python`, to be changed."""
    from envgraph.cli._export import write_templates

    write_templates(folder)


@app.command("import")
@click.argument(
    "file",
    type=PATH,
    help="A published family (ga4cl); or levels: of letters (.xsb, .sok, .txt), MiniHack (.des), Tiled (.tmx, .tmj).",
)
@click.option(
    "--domain",
    show_default="burning_forest/paper.toml; for levels the family.toml of the directory, or sokoban",
    help="What else an environment is: a family.toml, its directory, or a bundled domain.",
)
@click.option("--name", show_default="that of the file", help="Name of the run that a family becomes.")
@click.option(
    "--output",
    "-o",
    type=PATH,
    show_default="the name of the file",
    help="Directory of the models that levels become.",
)
@click.option(
    "--legend",
    multiple=True,
    help="What is read as which letter of the domain's model: x=#; 17=# or Wall=# for the number or class of a tile.",
)
@overrides_option
@force_option
@directory_option
@format_option
def import_(
    file: Path,
    domain: str | None,
    name: str | None,
    output: Path | None,
    legend: tuple[str, ...],
    overrides: tuple[str, ...],
    force: bool,
    directory: Path,
    format: OutputFormat,
) -> None:
    """Read a published family, measure it, and keep it as a run; or write levels as models."""
    from envgraph.cli._levels import holds_levels, import_levels

    if holds_levels(file):
        if overrides:
            raise InvalidArgument("`--set` is about the family file of a domain, and levels become models")
        import_levels(file, domain, output, legend, format)
        return
    from envgraph.cli._family import import_family

    import_family(file, domain or "burning_forest/paper.toml", name, overrides, directory, force, format)


@app.command()
@run_argument
@click.option(
    "--steps",
    show_default="as in family.toml",
    help="Training steps for each environment; several budgets are separated by commas. "
    "A baseline gets as many steps as the whole family together.",
)
@count_option("--seeds", usual="as in family.toml", help="How many agents for each curriculum.")
@count_option("--seed-offset", least=0, usual="0", help="The seed of the first agent; the next has one more.")
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
    help="Other ways to train, with as many steps, separated by commas; or all, or none: direct (the target alone), "
    "optimistic (direct, with higher values at first), reversed, shuffled (other orders, the target last), randomised "
    "(an environment drawn for each episode), backplay (the target begun in the states of an optimal episode, the last "
    "state first), exploring (the target begun in any state), random (families without selection, one for each seed). "
    "By name also schedules, which choose earlier environments by the results so far: "
    "uniform, learning_progress, band, learnability, plr, robust_plr, exact_regret, exact_learnability.",
)
@click.option(
    "--student",
    show_default="tabular",
    help="Who learns: tabular, or a network of Stable-Baselines3 (sb3:ppo, sb3:dqn). Each has its own results.",
)
@count_option("--workers", default=1, help="How many agents learn at a time; changes no result.")
@click.option("--resume", is_flag=True, help="Go on with a training that was interrupted.")
@click.option(
    "--force",
    is_flag=True,
    help="Replace results of as many steps, or a training that was interrupted, if there are any.",
)
@directory_option
@format_option
def train(run: str, directory: Path, **asked: Any) -> None:
    """Train agents on curricula, single environments and controls, and evaluate them on the target."""
    from envgraph.cli._learn import train_agents
    from envgraph.files import write_lock
    from envgraph.search import run_file

    with write_lock(Path(run) if run.endswith(".json") else run_file(run, directory)):
        train_agents(run, directory, **asked)


@app.command()
@run_argument
@click.option("--output", "-o", type=PATH, show_default="report.html in the run", help="Where to.")
@directory_option
@format_option
def report(run: str, output: Path | None, directory: Path, format: OutputFormat) -> None:
    """Write one self-contained HTML page: the family, the search, the training; and print a short table."""
    from envgraph.cli._learn import write_report

    write_report(run, directory, output, format)


@app.command()
@click.argument("what", metavar="paper")
@click.option(
    "--output", "-o", type=PATH, default=Path("reproduction"), help="The directory of what is written."
)
@count_option(
    "--seeds", default=200, help="How many agents for each curriculum, and how many families of our own."
)
@click.option(
    "--steps",
    default="10000,50000,100000",
    help="Training steps for each environment; several budgets are separated by commas.",
)
@click.option(
    "--times/--no-times", default=True, help="Whether to measure how long generation takes (table 4)."
)
@count_option("--workers", default=1, help="How many agents learn at a time; changes no result.")
@click.option("--force", is_flag=True, help="Replace what an earlier one has written.")
@format_option
def reproduce(what: str, output: Path, **asked: Any) -> None:
    """Make the paper's experiments again, with many seeds and controls: which of its claims hold.

    Writes a page, its tables as CSV and its charts as SVG.
    """
    from envgraph.cli._reproduce import reproduce_paper

    reproduce_paper(what, output, **asked)


@app.command()
@click.argument(
    "families",
    nargs=-1,
    required=True,
    help="A family file with `[audit]`, a directory with an audit/audit.toml, or the name of a bundled domain; several "
    "are judged apart and together.",
)
@count_option("--seeds", least=2, usual="as in the file", help="Students of each decisive method.")
@count_option(
    "--controls", least=2, usual="as in the file", help="Students of each other method, no more than --seeds."
)
@count_option(
    "--steps",
    least=8 * 4096,
    usual="as in the file",
    help="Steps of each student, with all that it costs to score levels.",
)
@click.option("--methods", show_default="all", help="Some methods by their names, separated by semicolons.")
@overrides_option
@count_option("--workers", "--jobs", default=1, help="How many students learn at a time; changes no result.")
@click.option("--force", is_flag=True, help="Replace an audit of other files or with other settings.")
@click.option("--directory", "-d", type=PATH, default=Path("audits"), help="Where audits are kept.")
@format_option
def audit(families: tuple[str, ...], directory: Path, **asked: Any) -> None:
    """Say what the scores by which curricula choose levels rank, teach and cost, beside exact regret and learnability.

    An audit that was interrupted goes on where it was. Writes audit.html, its figures, and tables as CSV.
    """
    from envgraph.cli._audit import audit_scores

    audit_scores(families, directory, **asked)
