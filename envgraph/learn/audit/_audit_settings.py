"""Parse and check the section `[audit]` of a family file."""

from __future__ import annotations

from typing import Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, LoadError, did_you_mean
from envgraph.lang import ComponentSpec, FamilySpec, Workspace
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType
from envgraph.search import ComponentOptions, Domain
from envgraph.solve.learning import PolicySettings


@dataclass(frozen=True, slots=True)
class AuditProtocol:
    """The numbers that are the same in all audits; `docs/evidence/levels.md` has results with these numbers, so another
    needs new runs.
    """

    points: int = 8  # of a learning curve, at equal distances; scores are probed at those in `PROBES`
    probing_seeds: int = 16  # students that are probed; all of them learn by domain randomisation
    shown_rollouts: int = 16  # episodes of the scores in figures and tables
    together: int = 8  # levels that are probed at a time
    top: float = 0.1  # share of levels that count as ranked highest by a score
    hard: float = 0.8  # a level is hard if its shortest plan is longer than those of this share of held-out levels
    worst: float = 0.3  # share of the held-out levels that counts as the worst case
    margin: float = 0.01  # smallest gain in success that matters: if the whole interval is below, a claim fails
    patience: int = 20  # models drawn for each level needed, before an error is raised


PROTOCOL: Final = AuditProtocol()


@dataclass(frozen=True, slots=True)
class AuditSettings:
    """The settings of an audit, except its methods.

    Attributes:
        sees: patterns whose first parameter is an object that the environment observes. A student sees the other values
            of their rows in the initial model of the level.
        knows: patterns whose rows a student sees in all states of a level.
        levels: number of levels for training, by default 6,000.
        held_out: number of solvable levels that students are tested on, by default 400. Half as many hard levels are
            added.
        probed: number of levels that scores are evaluated on, by default 300.
        steps: environment steps of each student, including those for scoring levels; by default 1,000,000.
        seeds: number of students of each decisive method, by default 100.
        controls: number of students of each other method, by default 30.
        scale: factor for the rewards of the student, which learns best from returns of about 1; by default 1.
        policy: settings of the students.
    """

    sees: tuple[str, ...]
    knows: tuple[str, ...]
    levels: int
    held_out: int
    probed: int
    steps: int
    seeds: int
    controls: int
    scale: float
    policy: PolicySettings


def check_audit(spec: FamilySpec, workspace: Workspace) -> list[Diagnostic]:
    """Return the errors in the `[audit]` of a family whose files have no other errors; [] without `[audit]`."""
    if spec.audit is None:
        return []
    try:
        parse_audit_settings(Domain(spec, workspace))
    except LoadError as error:
        return list(error.diagnostics)
    return []


def parse_audit_settings(domain: Domain) -> AuditSettings:
    """Return the audit settings of a domain's family file.

    Raises:
        LoadError: the file has no `[audit]`, no environment or no end of episodes, or an error in `[audit]`.
    """
    spec = domain.spec
    top = spec.source.span_between(0, 0) if spec.source else None
    if spec.audit is None:
        hint = 'write `[audit]` and `sees = ["..."]`: patterns that say what a student sees'
        raise LoadError([Diagnostic("missing-key", "the family file has no `[audit]`", top, hint)])
    behaviour = domain.behaviour
    problems: list[Diagnostic] = []
    limit = spec.limit or (behaviour.limit if behaviour else None)
    if behaviour is None:
        hint = 'write `environment = "name.environment"` at the top'
        problems.append(Diagnostic("missing-key", "an audit needs an environment", spec.audit.span(), hint))
    elif limit is None:
        hint = "write `limit = 64` at the top"
        problems.append(Diagnostic("missing-key", "an audit needs a `limit` of episodes", spec.audit.span(), hint))
    elif behaviour.agents:
        message = "an audit trains a single agent, but this environment has `agent` blocks"
        problems.append(Diagnostic("bad-audit", message, behaviour.agents[0].span))
    options = ComponentOptions(spec.audit)
    names = [*(options.names("sees") if options.is_given("sees") else ())]
    known = [*(options.names("knows") if options.is_given("knows") else ())]
    settings = AuditSettings(
        sees=tuple(names),
        knows=tuple(known),
        levels=options.integer("levels", 6000, 64, "members"),
        held_out=options.integer("held_out", 400, 20, "members"),
        probed=options.integer("probed", 300, 20, "members"),
        steps=options.integer("steps", 1_000_000, 8 * 4096, "steps"),
        seeds=options.integer("seeds", 100, 2, "members"),
        controls=options.integer("controls", 30, 2, "members"),
        scale=options.number("scale", 1.0, 1e-6, 1e6),
        policy=PolicySettings(
            hidden=options.integer("hidden", 64, 1, "hidden units"),
            learning_rate=options.number("learning_rate", 0.002, 1e-9, 1.0),
            entropy=options.number("entropy", 0.05, 0.0, 10.0),
            discount=options.number("discount", 0.97, 0.0, 1.0),
            limit=limit or 1,
        ),
    )
    options.finish()
    problems += options.problems
    problems += _check_patterns(domain, spec.audit, "sees", names, anchored=True)
    problems += _check_patterns(domain, spec.audit, "knows", known, anchored=False)
    if problems:
        raise LoadError(problems)
    return settings


def _check_patterns(
    domain: Domain, spec: ComponentSpec, key: str, names: list[str], *, anchored: bool
) -> list[Diagnostic]:
    """Return errors for patterns that are unknown, or whose rows a student cannot see."""
    registration = domain.workspace.registration
    assert registration is not None, "the files have no errors"
    library, problems = registration.library, list[Diagnostic]()
    for place, name in enumerate(names):
        span = spec.span(key, place)
        pattern = library.resolve(name)
        if pattern is None:
            hint = did_you_mean(name, [one.rpartition(".")[2] for one in library.names()])
            problems.append(Diagnostic("unknown-pattern", f"unknown pattern `{name}`", span, hint))
            continue
        types = library.parameter_types(pattern.qualified_name)
        if anchored and not (types and isinstance(types[0], ObjectType)):
            message = f"the first parameter of `{name}` must be an object"
            hint = f"give it an object that the environment observes, or write it in `knows` instead of `{key}`"
            problems.append(Diagnostic("wrong-type", message, span, hint))
        elif any(one is Scalar.FLOAT for one in types):
            message = f"`{name}` has a float among its parameters, which cannot be an input of a student"
            problems.append(Diagnostic("wrong-type", message, span, "use an int or an enum instead"))
    return problems
