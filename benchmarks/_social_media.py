"""The social media case of the Transformation Tool Contest 2018: its data, and the three best of a score."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from heapq import heapify, heappop, heappush, nlargest, nsmallest
from pathlib import Path

from envgraph.graph import Model
from envgraph.lang import bundled_domain, open as open_engine
from envgraph.rewrite import Engine, Match

DATA = Path(__file__).parents[1] / "tests" / "data" / "ttc18"
SCALES = (1, 4)
CHANGE_SETS = 20
QUERIES = {"Q1": "postScore", "Q2": "commentScore"}
"""Each query of the case, and the pattern that gives its scores."""

KINDS = ("Users", "Posts", "Comments", "Friends", "Likes")
"""What a line may insert, in an order in which the initial files can be read."""

Line = tuple[str, ...]
"""One insertion: its kind, then the fields. `Users` id, name; `Posts` id, timestamp, content, submitter; `Comments`
the same and the commented submission; `Friends` user, user; `Likes` user, comment."""


def initial_lines(scale: int) -> list[Line]:
    """The insertions that make the initial model of a scale."""
    return [
        (kind, *fields) for kind in KINDS for fields in _rows(DATA / str(scale) / f"csv-{kind.lower()}-initial.csv")
    ]


def change_sets(scale: int) -> list[list[Line]]:
    """The insertions of the 20 change sets of a scale."""
    numbers = range(1, CHANGE_SETS + 1)
    return [list(map(tuple, _rows(DATA / str(scale) / f"change{number:02}.csv"))) for number in numbers]


def copies(lines: Iterable[Line], number: int) -> list[Line]:
    """So many networks that do not touch: the lines, and the same with ids beyond those of the data."""
    return [
        (kind, *(str(int(f) + copy * 10**7) if c in _ID_COLUMNS[kind] else f for c, f in enumerate(fields)))
        for copy in range(number)
        for kind, *fields in lines
    ]


_ID_COLUMNS = {"Users": (0,), "Posts": (0, 3), "Comments": (0, 3, 4), "Friends": (0, 1), "Likes": (0, 1)}


def expected_answers() -> dict[tuple[str, int, int], list[int]]:
    """The published answers, best first, by query, scale, and number of change sets applied."""
    with open(DATA / "expected.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter=";"))
    return {
        (row["View"], int(row["ChangeSet"]), int(row["Iteration"])): [int(id) for id in row["MetricValue"].split("|")]
        for row in rows
    }


def _rows(path: Path) -> Iterator[list[str]]:
    with open(path, encoding="utf-8", newline="") as file:
        yield from csv.reader(file, delimiter="|", quoting=csv.QUOTE_NONE)


def open_network(lines: Iterable[Line] = ()) -> tuple[Engine, SocialNetwork]:
    """An engine with the queries of the case, on a model that the lines make."""
    engine = open_engine(bundled_domain("social_media") / "social_media.query")
    network = SocialNetwork(engine.model)
    with engine.model.loading():
        network.insert(lines)
    return engine, network


class SocialNetwork:
    """A model of the social media metamodel that grows line by line.

    Attributes:
        model: the model.
        users, submissions: the objects of the model by the ids of the data.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.users: dict[str, int] = {}
        self.submissions: dict[str, int] = {}
        user = model.metamodel.features("User")
        comment = model.metamodel.features("Comment")
        self._user_id, self._name, self._friends = user["id"], user["name"], user["friends"]
        self._id, self._timestamp, self._content = comment["id"], comment["timestamp"], comment["content"]
        self._submitter = comment["submitter"]
        self._commented, self._liked_by = comment["commented"], comment["likedBy"]

    def insert(self, lines: Iterable[Line]) -> None:
        """Make the insertions, in order."""
        users, submissions, link = self.users, self.submissions, self.model.graph.link
        for kind, *fields in lines:
            if kind == "Comments":
                *own, above = fields
                link(self._submission("Comment", *own), self._commented, submissions[above])
            elif kind == "Posts":
                self._submission("Post", *fields)
            elif kind == "Likes":
                user, comment = fields
                link(submissions[comment], self._liked_by, users[user])
            elif kind == "Friends":
                one, other = fields
                link(users[one], self._friends, users[other])
            else:
                id, name = fields
                users[id] = node = self.model.graph.new("User")
                self.model.graph.set_value(node, self._user_id, int(id))
                self.model.graph.set_value(node, self._name, name)

    def _submission(self, cls: str, id: str, timestamp: str, content: str, submitter: str) -> int:
        model = self.model
        self.submissions[id] = node = model.graph.new(cls)
        model.graph.set_value(node, self._id, int(id))
        model.graph.set_value(node, self._timestamp, timestamp)
        model.graph.set_value(node, self._content, content)
        model.graph.link(node, self._submitter, self.users[submitter])
        return node


Place = tuple[int, int, int, int]
"""What submissions are ranked by, the smallest first: negative score, negative time, the id of the data, the object."""


class Podium:
    """The best submissions by score, the newer first among equals, kept from the net changes of a pattern.

    No update looks at a submission whose score did not change. Invariant: `_places` has the place of every submission
    with a score, and `_heap` is a heap with all of these places; others in it are of former scores and are dropped
    when they come to the top, or when they outnumber the valid ones.

    Args:
        matches: the present matches of a pattern whose parameters are a submission and a score; `update` wants to hear
            of each change (`engine.listen(pattern, podium.update)`).
        size: how many of the best are asked for.
    """

    def __init__(self, matches: Sequence[Match], size: int = 3) -> None:
        self.size = size
        self._places: dict[int, Place] = {}
        self._heap: list[Place] = []
        self.update(matches, ())

    def update(self, appeared: Sequence[Match], disappeared: Sequence[Match]) -> None:
        """Take note of a net change."""
        for match in disappeared:
            del self._places[match.row[0]]
        for match in appeared:
            place = _place(match)
            self._places[place[3]] = place
            heappush(self._heap, place)
        if len(self._heap) > 2 * len(self._places) + 64:
            self._heap = list(self._places.values())
            heapify(self._heap)

    def best(self) -> list[int]:
        """The ids (of the data) of the best, best first."""
        heap, found = self._heap, list[Place]()
        while heap and len(found) < self.size:
            place = heappop(heap)
            if self._places.get(place[3]) is place:  # not only equal: an old score may have come back
                found.append(place)
        for place in found:
            heappush(heap, place)
        return [place[2] for place in found]


def best(matches: Sequence[Match], size: int = 3) -> list[int]:
    """What a `Podium` of these matches answers, without one."""
    least = min(nlargest(size, (match.row[1] for match in matches)), default=0)
    return [place[2] for place in nsmallest(size, (_place(m) for m in matches if m.row[1] >= least))]


def _place(match: Match) -> Place:
    node, score = match.row
    submission = match.model.node(node)
    return -score, -int(submission.timestamp.translate(_DIGITS_ONLY)), submission["id"], node


_DIGITS_ONLY = str.maketrans("", "", "-: ")
