"""Declarations of the commands on families and problems: names, arguments and options. Other modules implement them."""

from __future__ import annotations

from pathlib import Path

import click

from envgraph.cli._app import app
from envgraph.cli._shared_options import (
    PATH,
    count_option,
    directory_option,
    force_option,
    format_option,
    implemented_in,
    inputs_options,
    overrides_option,
    record_format,
    run_argument,
    seed_option,
    variant_option,
    workers_options,
)
from envgraph.errors import LIMITS


@app.command()
@click.argument("family", help="A family.toml, a directory with one, or the name of a bundled domain.")
@click.option("--name", show_default="that of the family", help="Name of the run.")
@seed_option
@count_option("--generations", minimum=0, help="Number of generations, instead of that in the file.")
@count_option("--population", help="Size of the family, instead of that in the file.")
@count_option(
    "--samples",
    minimum=2,
    help="Sample this number of different valid environments, instead of searching for a family.",
)
@overrides_option
@click.option(
    "--resume",
    is_flag=True,
    help="Resume an interrupted run, or, with a larger --generations, a finished one.",
)
@workers_options("Number of threads for the learners of an objective, or of processes for the measures of models.")
@click.option(
    "--require",
    type=float,
    metavar="VALUE",
    help="Exit with code 1 if the family has a lower value: share of learners that solve the target, or diversity.",
)
@force_option
@directory_option
@format_option
@implemented_in("_family_actions", "generate_family")
def generate() -> None:
    """Generate a family of environments from one model."""


@app.command()
@click.argument("problem", help="A family file with [optimise], a directory with a problem.toml, or a bundled domain.")
@seed_option
@count_option("--steps", help="Number of moves to try.")
@overrides_option
@count_option("--solution", default=1, help="Number of the solution in the Pareto front to write.")
@click.option("--output", "-o", type=PATH, help="File for the best model: .model, .xmi or .json.")
@click.option(
    "--trace",
    type=PATH,
    help="File for the rule applications that lead to it, for `envgraph replay`: JSON lines.",
)
@click.option(
    "--picture", type=PATH, help="File for a drawing of the Pareto front in the first two objectives, as SVG."
)
@format_option
@implemented_in("_optimise_command", "optimise_model")
def optimise() -> None:
    """Search for the model with the best values of some queries, by applying rules. Exit code 1 if it is invalid."""


@app.command("verify")
@run_argument
@click.option("--resume", is_flag=True, help="Skip environments that were verified before.")
@count_option("--members", default=100, help="Number of environments; of more, a sample is verified.")
@count_option("--seed", minimum=0, default=0, help="Random seed of sampled episodes.")
@workers_options("Number of processes.")
@directory_option
@format_option
@implemented_in("_verify_command", "verify_family")
def verify_() -> None:
    """Print properties of each environment of a family, computed twice by different methods.

    These are the fewest steps to success, the success probability of a random walk, and the optimal return: exact, or
    sampled if there are too many states. Exit code 1 if the two methods differ. A run stores the results.
    """


@app.command("runs")
@click.argument("compared", nargs=-1, metavar="[RUN OTHER]", help="Two runs to compare.")
@directory_option
@format_option
@implemented_in("_runs_command", "show_runs")
def runs_() -> None:
    """List all runs, or compare two of them: settings, file contents, figures and members."""


@app.command()
@click.argument(
    "run",
    help="A run: its name below `runs`, its directory or its run.sqlite; or a family file (.json), a model "
    "(.model, .xmi) or a metamodel (.metamodel, .ecore).",
)
@variant_option
@click.option("--lineage", metavar="VARIANT", help="Print the rule applications that led to this environment of a run.")
@click.option("--rejections", is_flag=True, help="Print why models were rejected in a run, and how often.")
@click.option(
    "--classes",
    metavar="NAMES",
    help="In a picture of a model draw only objects of these classes, separated by commas.",
)
@directory_option
@inputs_options
@click.option(
    "--format",
    type=click.Choice(["text", "json", "dot", "svg"], case_sensitive=False),
    default="text",
    callback=record_format,
    help="text or json; models and metamodels also as a picture: dot or svg.",
)
@click.option(
    "--output",
    "-o",
    type=PATH,
    show_default="standard output",
    help="File to write; the endings .json, .dot and .svg choose the format.",
)
@implemented_in("_show_command", "show")
def show() -> None:
    """Print a family: its measures and its maps. Or print a model or a metamodel: its contents, or a picture of it."""


@app.command("play")
@click.argument(
    "run",
    help="A run: its name below `runs`, its directory or its run.sqlite; a family file (.json); or a domain: its "
    "family.toml, its directory, the name of a bundled domain, or an .environment file.",
)
@click.argument(
    "variant",
    required=False,
    help="Name (E6) or number of an environment of the run, by default the last; for a domain a .model or .xmi file.",
)
@click.option(
    "--policy",
    type=click.Choice(["best", "random"]),
    help="Let an optimal or a random policy choose the action at each press of Enter.",
)
@click.option("--delay", type=float, metavar="SECONDS", help="Let the policy do a step after each delay, without keys.")
@count_option("--seed", minimum=0, default=0, help="Random seed of resets and steps.")
@click.option(
    "--record",
    type=PATH,
    metavar="FILE",
    help="Write the last episode as animation (.svg, .gif) or data (.json).",
)
@click.option("--window", is_flag=True, help="Open a window, which needs the extra `human`.")
@directory_option
@implemented_in("_play_command", "play")
def play_() -> None:
    """Play an environment by keys, or watch a policy play it.

    Without a terminal, each line of standard input is a key, the name of an action, or a command such as undo.
    """


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
@click.option("--output", "-o", type=PATH, show_default="standard output", help="File or directory to write.")
@click.option(
    "--templates",
    type=PATH,
    metavar="DIR",
    help="Templates for --format python, instead of those of `envgraph templates`.",
)
@directory_option
@implemented_in("_export_command", "export_family")
def export() -> None:
    """Write a family in another format."""


@app.command()
@click.argument(
    "shown",
    metavar="[DOMAIN]",
    required=False,
    help="A folder with files of a domain, by default the working directory; a bundled domain; or a run.",
)
@click.option("--port", type=click.IntRange(1, 65535), show_default="a free port", help="Port of the page.")
@click.option("--no-browser", is_flag=True, help="Only print the address, and do not open it.")
@directory_option
@implemented_in("_serve_command", "serve_page")
def serve() -> None:
    """Show a domain or a run in the browser: edit files, see models, apply rules, play levels, search.

    Only this machine can open the page, by the printed address, which contains a secret token. Ctrl-C stops it.
    """


@app.command("templates")
@click.argument("folder", type=PATH, help="Directory to write to; it must be empty.")
@implemented_in("_export_command", "write_templates")
def templates_() -> None:
    """Write the templates of `envgraph export --format python`, so that you can change them."""


@app.command("import")
@click.argument(
    "file",
    type=PATH,
    help="A published family (ga4cl); or levels, also a directory of them: of letters (.xsb, .sok, .txt), MiniHack "
    "(.des), Tiled (.tmx, .tmj).",
)
@click.option(
    "--domain",
    show_default="burning_forest/paper.toml; for levels the family.toml of the directory, or sokoban; "
    "with --to family sokoban/levels.toml",
    help="Domain of the environments: a family.toml, its directory, or a bundled domain.",
)
@click.option(
    "--to",
    type=click.Choice(["models", "family"]),
    show_default="models for levels",
    help="Write levels as models, or store those that satisfy the constraints of the domain as a family.",
)
@click.option("--name", show_default="that of the file", help="Name of the run for a family.")
@click.option(
    "--output",
    "-o",
    type=PATH,
    show_default="the name of the file",
    help="Directory for the models of levels.",
)
@click.option(
    "--legend",
    multiple=True,
    help="The domain's letter for a letter in the file (x=#), or for the number or class of a tile (17=#, Wall=#).",
)
@overrides_option
@force_option
@directory_option
@format_option
@implemented_in("_import_levels", "import_file")
def import_() -> None:
    """Read a published family or levels, compute their measures, and store them as a run; or write levels as models."""


@app.command()
@run_argument
@click.option(
    "--steps",
    show_default="as in family.toml",
    help="Training steps for each environment; several budgets are separated by commas. "
    "A baseline gets as many steps as the whole family together.",
)
@count_option("--seeds", default_text="as in family.toml", help="Number of agents for each curriculum.")
@count_option("--seed-offset", minimum=0, default_text="0", help="The seed of the first agent; the next has one more.")
@click.option(
    "--curricula",
    show_default="as in family.toml, and the baselines",
    help="One or more of suffixes (E1-E6, E2-E6 ...), full (E1-E6), baselines (each environment alone) and direct "
    "(the target alone), separated by commas. With a curriculum among them, agents are also trained on the "
    "family up to each environment, and evaluated there.",
)
@click.option(
    "--controls",
    show_default="all but random, where there is a curriculum",
    help="Other ways to train in the same number of steps, separated by commas; or all or none: direct (the target), "
    "optimistic (direct, with higher initial values), reversed, shuffled (other orders, the target last), randomised "
    "(an environment sampled for each episode), backplay (the target started in states of an optimal episode, last "
    "state first), exploring (the target started in any state), random (unselected families, one for each seed). "
    "Schedules may be named too; they choose environments by the results so far: "
    "uniform, learning_progress, band, learnability, plr, robust_plr, exact_regret, exact_learnability.",
)
@click.option(
    "--student",
    show_default="tabular",
    help="The learner: tabular, or a network of Stable-Baselines3 (sb3:ppo, sb3:dqn). Each has its own results.",
)
@workers_options("Number of agents that learn in parallel.")
@count_option(
    "--members",
    minimum=2,
    default_text=f"all; the population in family.toml, if there are more than {LIMITS['curriculum']}",
    help="Train on this number of environments, the target and others that are evenly spaced by the measure that "
    "orders the family.",
)
@overrides_option
@click.option("--resume", is_flag=True, help="Resume an interrupted training.")
@click.option(
    "--force",
    is_flag=True,
    help="Replace existing results of the same budget, or an interrupted training.",
)
@directory_option
@format_option
@implemented_in("_training_commands", "train_agents")
def train() -> None:
    """Train agents on curricula, single environments and controls, and evaluate them on the target."""


@app.command()
@run_argument
@click.option("--output", "-o", type=PATH, show_default="report.html in the run", help="File to write.")
@directory_option
@format_option
@implemented_in("_training_commands", "write_report")
def report() -> None:
    """Write one self-contained HTML page about the family, the search and the training; and print a short table."""


@app.command()
@click.argument("what", metavar="paper")
@click.option("--output", "-o", type=PATH, default=Path("reproduction"), help="Directory for all results.")
@count_option("--seeds", default=200, help="Number of agents for each curriculum, and of newly generated families.")
@click.option(
    "--steps",
    default="10000,50000,100000",
    help="Training steps for each environment; several budgets are separated by commas.",
)
@click.option("--times/--no-times", default=True, help="Measure how long generation takes (table 4).")
@workers_options("Number of agents that learn in parallel.")
@click.option("--force", is_flag=True, help="Replace the results of an earlier reproduction.")
@format_option
@implemented_in("_reproduce_command", "reproduce_paper")
def reproduce() -> None:
    """Repeat the paper's experiments with many seeds and controls, and report which of its claims hold.

    Writes a page, its tables as CSV and its charts as SVG.
    """


@app.command()
@click.argument(
    "families",
    nargs=-1,
    required=True,
    help="A family file with `[audit]`, a directory with an audit/audit.toml, or the name of a bundled domain; several "
    "are evaluated separately and together.",
)
@count_option("--seeds", minimum=2, default_text="as in the file", help="Number of students for each decisive method.")
@count_option(
    "--controls",
    minimum=2,
    default_text="as in the file",
    help="Number of students for each other method, at most --seeds.",
)
@count_option(
    "--steps",
    minimum=8 * 4096,
    default_text="as in the file",
    help="Steps of each student, including the steps for scoring levels.",
)
@click.option("--methods", show_default="all", help="Names of methods, separated by semicolons.")
@overrides_option
@workers_options("Number of students that learn in parallel.", "--jobs")
@click.option("--force", is_flag=True, help="Replace an audit of other files or with other settings.")
@click.option("--directory", "-d", type=PATH, default=Path("audits"), help="Directory of all audits.")
@format_option
@implemented_in("_audit_command", "audit_scores")
def audit() -> None:
    """Evaluate the scores by which curricula choose levels: ranking, training effect and cost.

    The references are exact regret and learnability. An interrupted audit is resumed. Writes audit.html, its figures,
    and tables as CSV.
    """
