"""`envgraph train`, interrupted and resumed."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from envgraph.cli import main
from envgraph.env import ExploredEnvironment, FloatRange, TooManyStates
from envgraph.env.compiled import NotCompiled
from envgraph.errors import InvalidArgument
from envgraph.learn import RunResult, TrainingJournal
from envgraph.search import Family, Member, generate
from envgraph.solve.learning import Curve
from tests.profile import AT_NIGHT

AGENT = RunResult("curriculum", "E1-E2", 0, 100, 1, 1.0, 1.0, 5.0, 0, 0.0, Curve((100,), (0.0,), (1,), (0,)))
TRAIN = ("train", "forest", "--steps", "200,300", "--seeds", "2")
AGENTS = 2 * (3 * 2 + 11 * 2 + 1 * 2)  # budgets x (a curriculum, baselines, controls, the first environment) x seeds


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    generate("burning_forest/paper.toml", path, generations=1, population=2)
    return path.read_bytes()


@pytest.fixture
def run(store: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "runs" / "forest"
    place.mkdir(parents=True)
    (place / "run.sqlite").write_bytes(store)
    return place


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> object:
    def typed(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["envgraph", *words])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        return (code, *capsys.readouterr())

    return typed


def results(place: Path) -> dict[str, bytes]:
    base = place / "training"
    return {str(path.relative_to(base)): path.read_bytes() for path in sorted(base.rglob("*.*"))}


def interrupt_after(count: int, monkeypatch: pytest.MonkeyPatch) -> list[RunResult]:
    """Ctrl-C comes when so many agents have ended; the list has those of this process."""
    trained: list[RunResult] = []
    add = TrainingJournal.add

    def counted(self: TrainingJournal, part: str, target: str, result: RunResult) -> None:
        if len(trained) == count:
            raise KeyboardInterrupt
        add(self, part, target, result)
        trained.append(result)

    monkeypatch.setattr(TrainingJournal, "add", counted)
    return trained


@pytest.mark.parametrize("count", [0, pytest.param(7, marks=AT_NIGHT), AGENTS - 1])
def test_a_resumed_training_has_the_same_results_byte_for_byte(
    run: Path, command: object, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(*TRAIN)[0] == 0  # type: ignore[operator]
    whole = results(run)
    assert len(whole) == 12 and not any("unfinished" in name for name in whole)
    for name in whole:
        (run / "training" / name).unlink()
    interrupt_after(count, monkeypatch)
    code, _, messages = command(*TRAIN)  # type: ignore[operator]
    assert code == 130
    assert messages == (
        f"{count} agents are saved: `envgraph train forest --directory runs --resume` resumes the training\n"
        "interrupted\n"
    )
    monkeypatch.undo()
    monkeypatch.chdir(run.parents[1])
    trained = interrupt_after(AGENTS, monkeypatch)
    assert command(*TRAIN, "--resume")[0] == 0  # type: ignore[operator]
    assert len(trained) == AGENTS - count
    assert results(run) == whole


def test_a_new_training_does_not_overwrite_an_interrupted_training(
    run: Path, command: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_after(3, monkeypatch)
    command(*TRAIN)  # type: ignore[operator]
    before = results(run)
    code, _, messages = command(*TRAIN)  # type: ignore[operator]
    assert code == 1 and "interrupted: resume it with --resume, or replace it with --force" in messages
    assert "holds the 3 agents of a training" in messages
    code, _, messages = command("train", "forest", "--resume", "--seeds", "3")  # type: ignore[operator]
    assert code == 1 and "the interrupted training has other seeds: `2`, not `3`; leave `--seeds` out" in messages
    assert results(run) == before
    file = run / "training" / "unfinished.jsonl"
    text = file.read_text(encoding="utf-8")
    for old, new in (('"seeds": 2', '"seeds": "2"'), ('"made_of": "', '"made_of": "0')):
        file.write_text(text.replace(old, new), encoding="utf-8")
        code, _, messages = command("train", "forest", "--resume")  # type: ignore[operator]
        assert code == 1 and str(Path("training") / "unfinished.jsonl") in messages
    file.unlink()
    code, _, messages = command("train", "forest", "--resume")  # type: ignore[operator]
    assert code == 1 and "no interrupted training to resume" in messages


def test_an_error_before_the_first_agent_leaves_no_journal(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise InvalidArgument("the tables do not fit")

    with monkeypatch.context() as patch:
        patch.setattr("envgraph.cli._training_commands.run_experiment", fail)
        assert command(*TRAIN)[0] == 1
    assert not (run / "training" / "unfinished.jsonl").exists()
    assert command(*TRAIN)[0] == 0


def test_finished_agents_are_kept_if_a_worker_process_dies(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    add = TrainingJournal.add
    with monkeypatch.context() as patch:

        def kill_workers(self: TrainingJournal, part: str, target: str, result: RunResult) -> None:
            add(self, part, target, result)
            for worker in multiprocessing.active_children():
                os.kill(worker.pid or 0, signal.SIGTERM)

        patch.setattr(TrainingJournal, "add", kill_workers)
        code, _, messages = command(*TRAIN, "--workers", "2")
    count = len(TrainingJournal.open(run / "training" / "unfinished.jsonl"))
    assert count >= 1 and code == 1
    assert messages == (
        f"{count} agents are saved: `envgraph train forest --directory runs --resume` resumes the training\n"
        "error: a worker process died, perhaps because memory ran out; use fewer `workers`, which need less memory\n"
    )
    assert command("train", "forest", "--resume")[0] == 0
    resumed = results(run)
    assert command(*TRAIN, "--force")[0] == 0 and results(run) == resumed


def test_results_are_replaced_only_by_force(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, both = ("train", "forest", "--seeds", "1", "--steps", "50"), ("train", "forest", "--steps", "50,60")
    assert command(*one)[0] == 0
    before = results(run)
    code, _, messages = command(*both, "--seeds", "2")
    place = Path("runs", "forest", "training", "50")
    assert code == 1
    assert messages == f"error: `{place}` exists already: replace it with --force, or choose other --steps\n"
    code, _, messages = command("train", "forest", "--resume", "--force")
    assert code == 1 and "cannot be combined" in messages
    assert results(run) == before
    with monkeypatch.context() as patch:
        interrupt_after(1, patch)
        command(*both, "--seeds", "2", "--force")
    assert (run / "training" / "unfinished.jsonl").exists()
    assert command(*both, "--seeds", "2", "--force")[0] == 0
    after = results(run)
    assert len(after) == 12 and all(after[name] != before[name] for name in before)


def test_printed_steps_of_an_agent_include_all_its_stages(run: Path, command: object) -> None:
    code, out, _ = command("train", "forest", "--steps", "200", "--seeds", "1")  # type: ignore[operator]
    rows = [[cell.strip() for cell in line.split("  ") if cell][:2] for line in out.splitlines()[3:12]]
    best = rows.pop(3)
    assert code == 0 and rows == [
        ["curriculum E1-E2", "400"],
        ["baseline E1", "400"],
        ["baseline E2", "400"],
        ["control randomised", "400"],
        ["control randomised, renewed", "400"],
        ["control backplay", "400"],
        ["control backplay, 2 stages", "400"],
        ["control exploring", "400"],
    ]
    assert best[0].startswith("control optimistic ") and best[1] == "400"
    labels = {line.split(",")[1] for line in (run / "training/200/runs.csv").read_text().splitlines()}
    assert len([label for label in labels if "optimistic" in label]) == 6
    assert out.startswith("None of 8 ways to train E2 with 400 steps succeeds with any of 1 agent.\n")
    assert "With 400 steps in all " in out and "\n  neither E1-E2 nor training on E2 alone succeeds " in out


def test_the_best_curriculum_or_control_is_printed_first_for_each_budget(
    run: Path, command: Callable[..., tuple[int, str, str]]
) -> None:
    short = ("train", "forest", "--steps", "2000,3000", "--seeds", "2", "--curricula", "full", "--force")
    chosen = (*short, "--controls", "direct,backplay")
    code, out, _ = command(*chosen)
    lines = out.splitlines()
    for line, steps in zip(lines, (4_000, 6_000), strict=False):
        assert line.startswith(f"Best of 4 ways to train E2 with {steps:,} steps: ") and "backplay" in line
    code, out, _ = command(*chosen, "--format", "json")
    ways = json.loads(out)["ways"]
    assert code == 0 and [one["text"] for one in ways] == lines[:2]
    assert ways[0]["target"] == "E2" and "backplay" in ways[0]["best"] and ways[0]["needs_curriculum"]
    assert command("report", "forest")[0] == 0
    summary = re.search('<p class="summary">(.*?)</p>', (run / "report.html").read_text(encoding="utf-8"))
    assert summary and " ".join(lines[:2]) in unescape(summary[1])


def test_backplay_is_skipped_if_no_optimal_episode_succeeds(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.learn._controls.optimal_episode", lambda target, limit: [])
    code, out, told = command("train", "forest", "--steps", "50", "--seeds", "1", "--curricula", "full")
    assert code == 0 and "control exploring" in out and "control backplay" not in out
    assert "`backplay` is skipped: no optimal episode of two steps or more ends in success\n" in told


def test_controls_are_chosen_or_left_out(run: Path, command: Callable[..., tuple[int, str, str]]) -> None:
    short = ("train", "forest", "--steps", "50", "--seeds", "1", "--curricula", "full", "--force")
    for chosen, expected in (
        ("none", ["curriculum E1-E2"]),
        ("direct, reversed", ["curriculum E1-E2", "baseline E2"]),
        ("exploring", ["curriculum E1-E2", "control exploring"]),
        ("plr", ["curriculum E1-E2"]),  # there is no choice before the target
    ):
        code, out, _ = command(*short, "--controls", chosen, "--format", "json")
        assert code == 0
        assert [f"{one['kind']} {one['label']}" for one in json.loads(out)["results"]] == expected
        told = json.loads(out)["comparisons"]
        assert [one["control"] for one in told] == [label.split()[1] for label in expected[1:]]
        assert all(one["steps"] == 100 and " E1-E2 " in one["text"] for one in told)
    code, _, messages = command(*short, "--controls", "optimist")
    assert code == 1 and "unknown control `optimist`" in messages and "did you mean `optimistic`?" in messages
    code, _, messages = command(*short, "--controls", "nothing")
    assert code == 1 and "there are `direct`, `optimistic`, `reversed`, `shuffled`, `randomised`" in messages
    code, out, _ = command(*short[:-3], "--curricula", "direct", "--force", "--format", "json")
    assert [one["kind"] for one in json.loads(out)["results"]] == ["baseline"]


def test_the_control_named_random_trains_random_families(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    train = ("train", "forest", "--steps", "100", "--seeds", "2", "--curricula", "full")
    assert command(*train, "--controls", "random, direct", "--format", "json")[0] == 0
    whole = results(run)
    rows = (run / "training" / "100" / "runs.csv").read_text().splitlines()[1:]
    labels = [row.split(",")[1] for row in rows]
    assert labels == ["E1-E2"] * 2 + ["E2"] * 2 + ["random families"] * 2
    with monkeypatch.context() as patch:
        interrupt_after(5, patch)
        assert command(*train, "--controls", "random, direct", "--force")[0] == 130
    assert command("train", "forest", "--resume")[0] == 0
    assert results(run) == whole
    assert command("export", "forest", "-o", "forest.json")[0] == 0
    code, _, messages = command("train", "forest.json", "--controls", "random", "--steps", "50")
    assert code == 1 and "`--controls random` needs a run: `forest.json` does not record" in messages


def test_the_option_seed_offset_trains_agents_with_other_seeds(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def rows() -> dict[tuple[str, str], str]:
        lines = (run / "training" / "100" / "runs.csv").read_text().splitlines()
        names = lines[0].split(",")
        cells = [dict(zip(names, line.split(","), strict=True)) for line in lines[1:]]
        return {(one["label"], one["seed"]): line for one, line in zip(cells, lines[1:], strict=True)}

    words = "train forest --steps 100 --curricula full --force --controls"
    train = (*words.split(), "random, direct")
    assert command(*train, "--seeds", "3")[0] == 0
    every = rows()
    with monkeypatch.context() as patch:
        interrupt_after(3, patch)
        assert command(*train, "--seeds", "2", "--seed-offset", "1")[0] == 130
    code, _, messages = command("train", "forest", "--resume", "--seed-offset", "2")
    assert code == 1 and "other seed_offset: `1`, not `2`; leave `--seed-offset` out" in messages
    assert command("train", "forest", "--resume")[0] == 0
    assert {seed for _, seed in rows()} == {"1", "2"}
    same = {key: row for key, row in rows().items() if key[0] != "random families"}
    assert len(same) == 4 and same.items() <= every.items()
    assert command("report", "forest")[0] == 0
    assert "seeds 1 to 2" in (run / "report.html").read_text()


def test_environments_with_too_many_states_are_trained_in_compiled_programs(
    run: Path, command: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba")

    def refused(self: Family, member: Member, *, pictures: bool = False) -> ExploredEnvironment:
        raise TooManyStates(self.behaviour, 1)

    monkeypatch.setattr(Family, "explored", refused)
    code, out, told = command("train", "forest", "--steps", "300", "--seeds", "2", "--curricula", "full")  # type: ignore[operator]
    assert code == 0 and "curriculum E1-E2" in out
    assert "`BurningForest` has more than 1 states: agents learn in the compiled program" in told
    assert "skipped controls that need tables of all states: optimistic, randomised, backplay, exploring" in told
    assert "control" not in out and "baseline E2" in out  # of two members there is no other order
    assert (run / "training" / "300" / "runs.csv").is_file()
    code, _, messages = command("train", "forest", "--steps", "400", "--controls", "direct,randomised")  # type: ignore[operator]
    assert code == 1 and "`--controls randomised` needs tables of all states" in messages
    assert not (run / "training" / "unfinished.jsonl").exists()

    compiled = Family.program
    floats = (FloatRange(0.0, 1.0, False),)
    with monkeypatch.context() as patch:
        patch.setattr(Family, "program", lambda *given: replace(compiled(*given), observation_shape=floats))
        code, _, messages = command("train", "forest", "--steps", "400")  # type: ignore[operator]
    assert code == 1 and "train a network with `envgraph.sb3.make_vec` instead" in messages
    assert "agents learn in" not in messages

    def uncompiled(self: Family, members: object) -> None:
        raise NotCompiled("a unit")

    monkeypatch.setattr(Family, "program", uncompiled)
    code, _, messages = command("train", "forest", "--steps", "400")  # type: ignore[operator]
    assert code == 1 and "has more than 1 states, and it cannot be compiled: compiled environments" in messages
    assert "do not support a unit" in messages


def test_the_journal_syncs_each_added_agent_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = TrainingJournal.create(tmp_path / "unfinished.jsonl", {"made_of": ""})
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_size))
    for number in (1, 2):
        journal.add("100", "E2", replace(AGENT, seed=number))
        assert synced[-1] == journal.path.stat().st_size
    assert [one.seed for one in TrainingJournal.open(journal.path).results_of("100", "E2")] == [1, 2]
    journal.path.unlink()  # by somebody else
    with pytest.raises(FileNotFoundError):
        journal.add("100", "E2", AGENT)
    assert not journal.path.exists()


def test_students_are_named_and_need_their_package(
    run: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.solve.learning._training_settings.find_spec", lambda name: None)
    code, _, messages = command(*TRAIN, "--student", "sb3:ppo")
    wanted = "error: `sb3:ppo` needs Stable-Baselines3: pip install 'envgraph[sb3]'\n"
    assert (code, messages) == (1, wanted)
    code, _, messages = command(*TRAIN, "--student", "sb3:pppo")
    assert code == 1 and "`student` is 'sb3:pppo', it must be 'tabular' or 'sb3:ppo' or 'sb3:dqn'" in messages
    assert "did you mean `sb3:ppo`" in messages
    assert not (run / "training").exists()


def test_the_report_separates_results_by_student(run: Path, command: Callable[..., tuple[int, str, str]]) -> None:
    assert command("train", "forest", "--steps", "200", "--seeds", "2", "--student", "tabular")[0] == 0
    shutil.copytree(run / "training" / "200", run / "training" / "sb3-dqn" / "200")
    code, found, _ = command("report", "forest", "--format", "json")
    assert code == 0
    columns = ("success at 200", "return at 200", "success at 200, sb3:dqn", "return at 200, sb3:dqn")
    for row in json.loads(found)["environments"]:
        assert [*row][-4:] == [*columns] and row[columns[0]] == row[columns[2]]
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "Training for E2, 200 steps an environment<" in page
    assert "Training for E2, 200 steps an environment, sb3:dqn<" in page
    assert "training at 200 steps, sb3:dqn" in page
    assert re.search(r" sb3:dqn: (Best|None) of \d+ ways to train E2", page)
    shutil.rmtree(run / "training" / "200")
    rows = json.loads(command("report", "forest", "--format", "json")[1])["environments"]
    assert "success, sb3:dqn" in rows[0]
