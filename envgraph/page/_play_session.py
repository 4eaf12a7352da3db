"""Play an episode step by step: by actions, by a policy, and back again."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from random import Random
from threading import Event
from typing import TYPE_CHECKING, Any, Final

from envgraph.behaviour import clause_name
from envgraph.env import END_NAMES, PlayedEpisode, Simulator
from envgraph.errors import InvalidArgument, check_known
from envgraph.page._certificate import Certificate, certify_level
from envgraph.page._pictures import draw_state
from envgraph.page._work import JsonObject, Params, Work

if TYPE_CHECKING:
    from envgraph.env import AgentStepper
    from envgraph.search import Family, Member

POLICIES: Final = ("best", "random")


class PlaySession:
    """An episode of one environment that a person plays.

    Every random choice depends on the seed and on the number of the step alone, so that a step which is undone and
    repeated has the same result.

    Args:
        simulator: the environment; nothing else may use its model.
        limit: steps after which the episode is truncated; None for no limit.
        title: the name of the level.

    Attributes:
        certificate: the exact results about the level; None until they are known.
        episode: the episode; None before the first `start`.
    """

    def __init__(self, simulator: Simulator, limit: int | None = None, title: str = "") -> None:
        self.simulator, self.limit = simulator, limit
        self.title = title or simulator.behaviour.name
        self.certificate: Certificate | None = None
        self.episode: PlayedEpisode | None = None
        self._engine = simulator.engine.copy()  # stays in the initial state
        self._seed = 0
        self._rewards: list[dict[str, float]] = []
        self._chosen: list[tuple[int | None, bool]] = []  # the action of each step, and if the best policy chose it
        self._reward_names: dict[int, str] = {}
        for agent in simulator.agents.prepared_agents:
            for (clause, _), effect in zip(agent.behaviour.effect_clauses, agent.behaviour.effects, strict=True):
                self._reward_names[id(effect.reward)] = clause_name(clause)
            for action in agent.actions:
                for reward in (action.reward, action.else_reward):
                    self._reward_names[id(reward)] = action.name.partition("(")[0]

    @classmethod
    def of_member(cls, family: Family, member: Member) -> PlaySession:
        """Return a session that plays a copy of a member of a family."""
        simulator = Simulator(family.domain.engine(family.model(member)), family.behaviour, family.keys)
        return cls(simulator, family.limit, f"{family.name}, {member.name}")

    def answer(self, method: str, params: Params) -> JsonObject | Work:
        """Return the result of a request, or the work that leads to it.

        Methods: `page/play/start` {seed}, `page/play/step` {action}, `page/play/undo`, `page/play/policy` {policy} and
        `page/certificate`. All but the last return the state of the episode.

        Raises:
            InvalidArgument: there is no such method, action or policy, or the episode is over.
            RuleError: a rule is refused. Nothing has changed then.
            EvaluationError: a reward has no value. Nothing has changed then.
        """
        name = method.rpartition("/")[2]
        requests: dict[str, Callable[[], JsonObject | Work]] = {
            "start": lambda: self.start(params.get("seed", 0)),
            "step": lambda: self.step(params.get("action")),
            "undo": self.undo,
            "policy": lambda: self.follow(params.get("policy", "best")),
            "certificate": self.certify,
        }
        check_known(name, requests, f"there is no method `{method}`")
        return requests[name]()

    # --- requests

    def start(self, seed: Any = 0) -> JsonObject:
        """Begin an episode, and return its state."""
        if type(seed) is not int:
            raise InvalidArgument(f"`seed` must be a whole number, not {seed!r}")
        if self.episode is not None:
            self.episode.close()
        self._seed, self._rewards, self._chosen = seed, [], []
        self.episode = PlayedEpisode(self.simulator, self.limit, Random(seed).random)
        return self.state()

    def step(self, action: Any) -> JsonObject:
        """Do the action with this number, and return the state; of agents that act together, each chooses in turn."""
        if type(action) is not int:
            raise InvalidArgument(f"`action` must be the number of an action, not {action!r}")
        self._choose(action)
        return self.state()

    def _choose(self, action: int) -> bool:
        """Choose an action for the next agent; return True if this completes a step."""
        episode, stepper = self._begun(), self.simulator.current_stepper
        done = episode.choose(action)
        if done is not None:
            self._keep(stepper, action)
        return done is not None

    def undo(self) -> JsonObject:
        """Undo the last step, if there was one, and return the state before it."""
        episode = self._begun()
        episode.undo()
        del self._rewards[len(episode.steps) :], self._chosen[len(episode.steps) :]
        return self.state()

    def follow(self, policy: Any) -> JsonObject | Work:
        """Do one step of a policy, and return the state after it; the best policy is computed when first used."""
        check_known(policy, POLICIES, f"there is no policy `{policy}`")
        episode = self._begun()
        if episode.end:
            raise InvalidArgument("the episode is over", "undo the last step, or restart")
        if policy == "random":
            rng, is_done = Random(f"{self._seed} {len(episode.steps)}"), False
            while not is_done:
                is_done = self._choose(rng.choice([number for number, can in enumerate(episode.allowed) if can]))
            return self.state()
        if self.certificate is not None:
            return self._follow_best()
        work = self.certify()
        assert isinstance(work, Work), "the certificate is not known"
        keep = work.finish

        def finish(found: Certificate) -> JsonObject:
            keep(found)
            return self._follow_best()

        return Work(work.run, finish, work.stopped)

    def certify(self) -> JsonObject | Work:
        """Return the exact results about the level."""
        if self.certificate is not None:
            return self.certificate.data
        simulator, engine, stopped = self.simulator, self._engine.copy(), Event()

        def finish(found: Certificate) -> JsonObject:
            self.certificate = found
            return found.data

        def run() -> Certificate:
            return certify_level(engine, simulator.behaviour, simulator.keys, self.limit, stopped)

        return Work(run, finish, stopped)

    # --- the state

    def state(self) -> JsonObject:
        """Return the state of the episode for the page."""
        episode, simulator = self._begun(), self.simulator
        last, totals = episode.steps[-1] if episode.steps else None, episode.totals
        keys: list[list[str]] = [[] for _ in episode.action_names]
        for key, number in episode.bindings.items():
            keys[number].append(key)
        named = zip(episode.action_names, keys, episode.allowed, strict=True)
        chosen, by_best = self._chosen[-1] if self._chosen else (None, False)
        return {
            "title": self.title,
            "picture": draw_state(simulator.engine, simulator.behaviour, painter=simulator.painter),
            "observation": self._observed(),
            "actions": [{"name": name, "keys": own, "allowed": can} for name, own, can in named],
            "agent": episode.agent or None,
            "steps": len(episode.steps),
            "limit": self.limit,
            "reward": last.reward if last else 0.0,
            "rewards": self._rewards[-1] if self._rewards else {},
            "total": totals[-1],
            "terminated": episode.end > 0,
            "truncated": episode.end < 0,
            "end": END_NAMES.get(episode.end),
            "reason": (last.reason or None) if last else None,
            "chosen": chosen,
            "chosenName": last.name if last else None,
            "values": self._action_values() if by_best else None,
            "best": self.best(),
        }

    def best(self) -> JsonObject | None:
        """Return what is known of the level, with the discounted value of the current state; or None."""
        if self.certificate is None:
            return None
        value, advisor, episode = None, self.certificate.advisor, self._begun()
        if advisor is not None and not episode.end:
            value = float(advisor.action_values(episode).max())
        return {**self.certificate.data, "value": value, "discount": None if advisor is None else advisor.discount}

    def _action_values(self) -> list[float | None] | None:
        """Return the discounted return that the best policy expects after each action of the current state.

        Return None at the end of an episode, and for agents that act together.
        """
        advisor, episode = None if self.certificate is None else self.certificate.advisor, self._begun()
        if advisor is None or episode.end or self.simulator.joint_stepper is not None:
            return None
        return [one if isfinite(one) else None for one in advisor.action_values(episode).tolist()]

    def _observed(self) -> JsonObject:
        """Return the index of the observation, and its components by name."""
        index = rest = self.simulator.observe()
        found = {}
        for name, size in zip(self.simulator.observation_names, self.simulator.observation_shape, strict=True):
            rest, found[name] = divmod(rest, size)
        return {"index": index, "values": found}

    def _begun(self) -> PlayedEpisode:
        if self.episode is None:
            raise InvalidArgument("no episode has begun", "request `page/play/start` first")
        return self.episode

    def _keep(self, stepper: AgentStepper, chosen: int | None, by_best: bool = False) -> None:
        """Keep the rewards of the step that was just done, by the names of the clauses that paid them."""
        found: dict[str, float] = {}
        for reward, gain in stepper.paid:
            name = self._reward_names[id(reward)]
            found[name] = found.get(name, 0.0) + gain
        self._rewards.append(found)
        self._chosen.append((chosen, by_best))

    def _follow_best(self) -> JsonObject:
        found, episode = self.certificate, self._begun()
        if found is None or found.advisor is None:
            raise InvalidArgument("the best policy of this level is not known", "watch the random policy instead")
        action, stepper = found.advisor.action(episode), self.simulator.current_stepper
        episode.step(action)
        acts_alone = self.simulator.joint_stepper is None  # otherwise the action combines those of all agents
        self._keep(stepper, action if acts_alone else None, by_best=True)
        return self.state()
