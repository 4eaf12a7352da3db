"""The command `envgraph play`: play an environment by keys, or watch a policy."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from envgraph.behaviour import PLAY_COMMANDS, normal_key
from envgraph.cli._output import escape_json, print_line
from envgraph.cli._play_screens import PlayScreen, PlayView, open_screen
from envgraph.env import (
    END_NAMES,
    PlayedEpisode,
    TooManyStates,
    check_render_mode,
    episode_gif,
    episode_svg,
    episode_to_dict,
    scene_text,
)
from envgraph.errors import EnvgraphError, InvalidArgument, count_with_noun, did_you_mean
from envgraph.files import check_replaceable, replace_file
from envgraph.search import Family, Member, find_playable, format_certificates, play_episode

_COMMANDS: Final = {**PLAY_COMMANDS, "policy": ("Enter", ".")}
_KEY_NAMES: Final = {"Space": " "}
"""By name in a script: the key."""
_WALK_STEPS: Final = 200
"""The steps of a random walk whose success is shown, if the environment has no limit of steps."""
_RECORDINGS: Final = (".svg", ".gif", ".json")


def play(
    run: str,
    variant: str | None,
    policy: str | None,
    delay: float | None,
    seed: int,
    record: Path | None,
    window: bool,
    directory: Path,
) -> None:
    """Play a member of a run, or the model of a domain, and write the last episode into the file `record`.

    Args:
        variant: name or number of a member; for a domain the file of a model.
        policy: "best" or "random"; None if only people choose actions.
        delay: seconds between the steps of the policy; None if it does a step for each key.

    Raises:
        EnvgraphError: the run, domain or member does not exist, or a line of a script is wrong.
    """
    if delay is not None and (policy is None or not 0 <= delay <= 3600):
        raise InvalidArgument("`--delay` needs `--policy`, and a number of seconds from 0 to 3600")
    family, member = find_playable(run, variant, directory)
    drawn = family.behaviour.draw is not None
    if window:
        check_render_mode("human", drawn=drawn)
    if record is not None:
        if record.suffix not in _RECORDINGS:
            raise InvalidArgument(f"`{record}` is no recording: choose a file name that ends in .svg, .gif or .json")
        if record.suffix != ".json":
            check_render_mode("rgb_array", drawn=drawn)
        check_replaceable(record)
    game = _Game(family, member, seed, policy, delay)
    try:
        with open_screen(f"{member.name} of {family.name}" if window else None) as screen:
            _play_on(screen, game)
    finally:
        if record is not None:
            _write_recording(record, game)
    print_line(f"{game.title}: {game.status}")
    if record is not None:
        print_line(f"wrote {record}")


def _play_on(screen: PlayScreen, game: _Game) -> None:
    """Show the state and handle keys until the input ends. With `--delay` and a script, also stop after the episode."""
    while True:
        screen.show(game.view())
        waits = game.delay is not None and not game.episode.end
        if game.delay is not None and game.episode.end and screen.script_line:
            return
        key = screen.read_key(game.delay if waits else None)
        if key is None:
            return
        key = normal_key(_KEY_NAMES.get(key, key))
        if game.command_of(key) == "quit":
            return
        game.message = ""
        try:
            if key or game.policy is None:
                game.do(key or "Enter")
            else:
                game.do_policy()
        except EnvgraphError as error:
            if screen.script_line and isinstance(error, InvalidArgument):
                raise InvalidArgument(f"{screen.script_line}: {error.message}", error.hint) from None
            if screen.script_line:
                raise
            game.message = str(error)


class _Game:
    """The episode that is played, the member of the family, and the policy.

    Attributes:
        message: an answer to the last key; "" for none.
    """

    def __init__(self, family: Family, member: Member, seed: int, policy: str | None, delay: float | None) -> None:
        from numpy.random import default_rng

        self.family, self.policy, self.delay = family, policy, delay
        self._random: Callable[[], float] = default_rng(seed).random
        self._chosen = random.Random(seed)
        self._begin(member)

    def _begin(self, member: Member) -> None:
        """Begin to play a member; compute the best policy, if it is wanted. The message says what is known of it."""
        family = self.family
        facts = format_certificates(member, family.members)
        if self.policy == "best":
            from envgraph.solve import EpisodeAdvisor, certify

            try:
                table = family.explored(member).tabular
            except TooManyStates as error:
                message = f"no best policy is known for {member.name} of {family.name}: {error.message}"
                raise InvalidArgument(message, "use `--policy random`, or play by keys") from error
            self._advisor = EpisodeAdvisor(table)
            if not member.certificates:
                found = certify(table, limit=family.limit or _WALK_STEPS)
                facts = format_certificates(replace(member, certificates=found.values()))
        self.member = member
        self.episode: PlayedEpisode = play_episode(family, member, self._random)
        known = ", ".join(f"{name}: {value}" for name, value in facts)
        self.message = self.title + (f"; {known}" if known else "")

    @property
    def title(self) -> str:
        """Return the names of the member and the family."""
        return f"{self.member.name} of {self.family.name}"

    @property
    def status(self) -> str:
        """Return the number of steps, the last action, its reward, the total, and the end."""
        episode, steps = self.episode, self.episode.steps
        parts = [count_with_noun(len(steps), "step")]
        if steps:
            parts += [steps[-1].name, f"reward {steps[-1].reward:z.4g}"]
        parts.append(f"total {episode.totals[-1]:z.4g}")
        if episode.end:
            parts.append(f"{END_NAMES[episode.end]} by `{steps[-1].reason}`")
        elif episode.agent:
            parts.append(f"{episode.agent} acts")
        return ", ".join(parts)

    def view(self) -> PlayView:
        """Return the picture, the status, the actions and the commands of the current state."""
        episode = self.episode
        scene = episode.scenes[-1] if episode.scenes else None
        picture = scene_text(scene) if scene else episode.simulator.engine.model.picture().to_text()
        keys: dict[int, list[str]] = {}
        for key, number in episode.bindings.items():
            keys.setdefault(number, []).append(_key_text(key))
        actions = [
            (" ".join(["/".join(keys.get(number, [])), name]).strip(), can)
            for number, (name, can) in enumerate(zip(episode.action_names, episode.allowed, strict=True))
        ]
        commands = ", ".join(f"{self._key_of(command)} {command}".strip() for command in self._commands())
        return PlayView(scene, picture, self.status, tuple(actions), commands, self.message, self.title)

    def _commands(self) -> list[str]:
        """Return the commands that can be used: `next` needs several members, `policy` needs a policy."""
        without = {"next": len(self.family.members) == 1, "policy": self.policy is None}
        return [command for command in _COMMANDS if not without.get(command)]

    def _key_of(self, command: str) -> str:
        """Return the key of a command that is no key of an action; "" if there is none."""
        return next((key for key in _COMMANDS[command] if key not in self.episode.bindings), "")

    def command_of(self, key: str) -> str | None:
        """Return the command that a key or a word stands for; None if it stands for no command."""
        if key in self.episode.bindings:
            return None
        return next((one for one in self._commands() if key == one or key in _COMMANDS[one]), None)

    def do(self, key: str) -> None:
        """Do the action or the command that a key or a name stands for.

        Raises:
            EnvgraphError: the key or name is unknown, or the action is impossible.
        """
        episode, names = self.episode, self.episode.action_names
        number = episode.bindings.get(key)
        if number is None and key in names:
            number = names.index(key)
        if number is not None:
            episode.choose(number)
            return
        match self.command_of(key):
            case "undo":
                if not episode.undo():
                    self.message = "this is the first state"
            case "restart":
                episode.restart()
            case "next":
                members = self.family.members
                self._begin(members[(members.index(self.member) + 1) % len(members)])
            case "policy":
                self.do_policy()
            case _:
                known = [*map(_key_text, episode.bindings), *names, *self._commands()]
                hint = did_you_mean(key, known) or f"there are {', '.join(known)}"
                raise InvalidArgument(f"`{key}` is not the key or the name of an action or command", hint)

    def do_policy(self) -> None:
        """Do a step of the policy. Raise InvalidArgument if the episode is over."""
        episode = self.episode
        if self.policy == "best" and not episode.end:
            episode.step(self._advisor.action(episode))
            return
        before = len(episode.steps)
        while len(episode.steps) == before:  # agents that act together choose one after the other
            episode.choose(self._chosen.choice([number for number, can in enumerate(episode.allowed) if can] or [0]))


def _key_text(key: str) -> str:
    return "Space" if key == " " else key


def _write_recording(path: Path, game: _Game) -> None:
    """Write the steps of the episode, as the ending of the file name says."""
    episode, name = game.episode, game.title
    if path.suffix == ".svg":
        replace_file(path, episode_svg(episode, name))
    elif path.suffix == ".gif":
        replace_file(path, episode_gif(episode))
    else:
        data = {"family": game.family.name, "member": game.member.name, **episode_to_dict(episode)}
        replace_file(path, escape_json(json.dumps(data, ensure_ascii=False, indent=2)) + "\n")
