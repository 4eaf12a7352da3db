"""The queries of the social media domain against a plain Python evaluation, while a small network changes at random.

The published answers of the case only cover insertions; here likes, friendships, comments and users go as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field

from hypothesis import given, settings, strategies as st

from benchmarks._social_media import QUERIES, Podium, best, open_network
from envgraph.graph import Model, Node
from envgraph.match import FREE, Matcher
from envgraph.rewrite import Engine, Match
from tests.oracle.naive._naive import NaiveMatcher

EXAMPLES = settings().max_examples


@dataclass
class Oracle:
    """A network in sets and dicts, by the ids of the model. Nothing here uses the engine."""

    users: list[int] = field(default_factory=list)
    posts: list[int] = field(default_factory=list)
    above: dict[int, int] = field(default_factory=dict)
    """What each comment is on."""
    likes: set[tuple[int, int]] = field(default_factory=set)
    """User and comment."""
    friends: set[frozenset[int]] = field(default_factory=set)

    def below(self, submission: int) -> list[int]:
        """All comments on a submission, and on these."""
        found = [comment for comment, above in self.above.items() if above == submission]
        return found + [deeper for comment in found for deeper in self.below(comment)]

    def likers(self, comment: int) -> set[int]:
        """Who likes a comment."""
        return {user for user, liked in self.likes if liked == comment}

    def post_scores(self) -> dict[int, int]:
        """Ten and its likes for each comment below a post."""
        return {post: sum(10 + len(self.likers(comment)) for comment in self.below(post)) for post in self.posts}

    def comment_scores(self) -> dict[int, int]:
        """Squared sizes of the groups of friends who like a comment."""
        return {comment: sum(len(group) ** 2 for group in self.groups(comment)) for comment in self.above}

    def groups(self, comment: int) -> list[set[int]]:
        """The likers of a comment, those together that friendships among them join."""
        groups: list[set[int]] = []
        for user in self.likers(comment):
            joined = [group for group in groups if any(frozenset((user, one)) in self.friends for one in group)]
            groups = [group for group in groups if group not in joined]
            groups.append({user}.union(*joined))
        return groups


@dataclass
class Network:
    """A model and its oracle, which are changed together."""

    model: Model
    oracle: Oracle
    clock: int = 0

    def submission(self, cls: str, author: int) -> Node:
        """A new one; several may have the same time."""
        self.clock += 1
        timestamp = f"2010-02-09 03:{self.clock // 120:02}:{self.clock // 2 % 60:02}"
        return self.model.create(cls, id=self.clock, timestamp=timestamp, submitter=self.model.node(author))

    def edit(self, kind: str, first: int, second: int) -> None:
        """One change; the numbers choose what is changed, and choose nothing where there is nothing."""
        users, posts, comments = self.oracle.users, self.oracle.posts, list(self.oracle.above)
        submissions = posts + comments
        if kind == "user" or not users:
            users.append(self.model.create("User", id=len(users)).id)
            return
        user, other = users[first % len(users)], users[second % len(users)]
        if kind == "post" or not posts:
            posts.append(self.submission("Post", user).id)
            return
        place = submissions[second % len(submissions)]
        if kind == "comment" or not comments:
            new = self.submission("Comment", user)
            new.commented = self.model.node(place)
            self.oracle.above[new.id] = place
            return
        getattr(self, kind)(user, other, comments[second % len(comments)], submissions[first % len(submissions)])

    def like(self, user: int, _other: int, comment: int, _place: int) -> None:
        """A user likes a comment, or does no longer."""
        likes = self.model.node(user).likes
        if (user, comment) in self.oracle.likes:
            self.oracle.likes.remove((user, comment))
            likes.remove(self.model.node(comment))
        else:
            self.oracle.likes.add((user, comment))
            likes.append(self.model.node(comment))

    def friend(self, user: int, other: int, _comment: int, _place: int) -> None:
        """Two users become friends, or are no longer."""
        friends, both = self.model.node(user).friends, frozenset((user, other))
        if both in self.oracle.friends:
            self.oracle.friends.remove(both)
            friends.remove(self.model.node(other))
        elif user != other:
            self.oracle.friends.add(both)
            friends.append(self.model.node(other))

    def move(self, _user: int, _other: int, comment: int, place: int) -> None:
        """A comment goes to another place, with all that is below it."""
        if place not in (comment, *self.oracle.below(comment)):
            self.oracle.above[comment] = place
            self.model.node(comment).commented = self.model.node(place)

    def delete(self, _user: int, _other: int, _comment: int, place: int) -> None:
        """A submission goes, with all that is below it."""
        gone = {place, *self.oracle.below(place)}
        self.oracle.posts = [post for post in self.oracle.posts if post not in gone]
        self.oracle.above = {one: above for one, above in self.oracle.above.items() if one not in gone}
        self.oracle.likes = {(user, comment) for user, comment in self.oracle.likes if comment not in gone}
        self.model.graph.delete(place, "spo")

    def leave(self, user: int, _other: int, _comment: int, _place: int) -> None:
        """A user goes; what he wrote stays."""
        self.oracle.users.remove(user)
        self.oracle.likes = {like for like in self.oracle.likes if like[0] != user}
        self.oracle.friends = {both for both in self.oracle.friends if user not in both}
        self.model.graph.delete(user, "spo")


KINDS = ("user", "post", "comment", "like", "like", "friend", "friend", "move", "delete", "leave")
EDITS = st.lists(st.tuples(st.sampled_from(KINDS), st.integers(0, 11), st.integers(0, 11)), max_size=25)
START = (
    *5 * [("user", 0, 0)],
    *2 * [("post", 0, 0), ("comment", 0, 0), ("comment", 0, 2)],
    *[("friend", 0, 1), ("friend", 1, 2), ("friend", 3, 4)],
    *[("like", user, 0) for user in range(5)],
    *[("like", user, 1) for user in (0, 2, 3)],
)
"""A chain of three friends and a pair, who all like one comment; both ends of the chain like another."""


def start() -> tuple[Engine, Network]:
    """A small network and its oracle."""
    engine, _ = open_network()
    network = Network(engine.model, Oracle())
    for edit in START:
        network.edit(*edit)
    return engine, network


def scores(matcher: Matcher, pattern: str) -> dict[int, int]:
    """The matches of one of the two score patterns; each submission has one."""
    rows = matcher.rows(f"social_media.{pattern}", (FREE, FREE))
    assert len({submission for submission, _ in rows}) == len(rows)
    return dict(rows)


def assert_scores(matcher: Matcher, oracle: Oracle) -> None:
    """Both queries are right."""
    assert scores(matcher, "postScore") == oracle.post_scores()
    assert scores(matcher, "commentScore") == oracle.comment_scores()


def ranked(network: Network, scores: dict[int, int]) -> list[int]:
    """The three best by score, newer time, and smaller id."""

    def place(node: int) -> tuple[int, int, int]:
        submission = network.model.node(node)
        return scores[node], int(submission.timestamp.replace(":", "")[11:]), -submission["id"]

    return [network.model.node(node)["id"] for node in sorted(scores, key=place, reverse=True)[:3]]


@settings(max_examples=EXAMPLES // 4)
@given(EDITS)
def test_scores_of_both_matchers_equal_the_oracle(edits: list[tuple[str, int, int]]) -> None:
    engine, network = start()
    matchers = engine.matcher, NaiveMatcher(engine.model, engine.library)
    for edit in edits:
        network.edit(*edit)
        assert_scores(matchers[0], network.oracle)
    assert_scores(matchers[1], network.oracle)
    assert best(engine.matches("postScore")) == ranked(network, network.oracle.post_scores())
    assert best(engine.matches("commentScore")) == ranked(network, network.oracle.comment_scores())


class ScoreListener:
    """Hears of the net changes of a watched pattern, and keeps what its matches should be.

    Attributes:
        scores: by submission.
        podium: the best of them.
    """

    def __init__(self, engine: Engine, pattern: str) -> None:
        self.scores = scores(engine.matcher, pattern)
        self.podium = Podium(engine.matches(pattern))
        engine.listen(pattern, self.on_change)

    def on_change(self, appeared: Sequence[Match], disappeared: Sequence[Match]) -> None:
        """A net change: nothing in it was there already, nothing goes that was not there."""
        assert appeared or disappeared
        assert not set(appeared) & set(disappeared)
        for match in disappeared:
            assert self.scores.pop(match.row[0]) == match.row[1]
        for match in appeared:
            assert self.scores.setdefault(*match.row) == match.row[1]
        self.podium.update(appeared, disappeared)


class Refused(Exception):
    """Takes a transaction back."""


BATCHES = st.lists(st.tuples(st.sampled_from(("keep", "keep", "refuse", "back")), EDITS), max_size=6)


@settings(max_examples=EXAMPLES // 4)
@given(BATCHES)
def test_views_are_updated_by_changes_rollbacks_and_versions(
    batches: list[tuple[str, list[tuple[str, int, int]]]],
) -> None:
    engine, network = start()
    engine.watch(*QUERIES.values())
    audiences = {pattern: ScoreListener(engine, pattern) for pattern in QUERIES.values()}
    first = engine.commit(), deepcopy(network.oracle)
    for end, edits in batches:
        before = deepcopy(network.oracle), [engine.matches(pattern) for pattern in QUERIES.values()]
        with suppress(Refused), engine.transaction():
            for edit in edits:
                network.edit(*edit)
                assert_scores(engine.matcher, network.oracle)
            if end == "refuse":
                raise Refused
        if end == "refuse":
            network.oracle = before[0]
            assert [engine.matches(pattern) for pattern in QUERIES.values()] == before[1]
        if end == "back":
            engine.checkout(first[0], discard=True)
            network.oracle = deepcopy(first[1])
            engine.settle()
        assert_scores(engine.matcher, network.oracle)
        expected = network.oracle.post_scores(), network.oracle.comment_scores()
        for audience, right in zip(audiences.values(), expected, strict=True):
            assert audience.scores == right
            assert audience.podium.best() == ranked(network, right)
    engine.check_integrity()
