"""Draw the models of the bundled domains without an environment: before and after queries or rules do their work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import envgraph
from docs.pictures.drawing import sheet, tile
from envgraph.draw import FILL_COLOURS, Picture, PictureEdge, PictureNode
from envgraph.graph import Node
from envgraph.search import Domain, optimise_domain

MISTAKES = {
    "posLength": ("segment",),
    "switchMonitored": ("sw",),
    "routeSensor": ("route", "sensor"),
    "switchSet": ("sw",),
    "semaphoreNeighbor": ("route2", "semaphore"),
}
"""The queries for mistakes of a railway, with the parameters that name the wrong objects."""

Places = Mapping[str, tuple[float, float]]
"""The columns and rows of boxes, by the names of their objects."""


def pictures() -> dict[str, str]:
    """Return the pictures by their file names."""
    return {**railway_pictures(), **social_media_pictures(), **assignment_pictures()}


# --- railway: mistakes that queries find, and the same railway after rules have repaired them

RAILWAY: Places = {
    "arrive": (0.4, 0),
    "turn": (1.4, 0),
    "leave": (2.8, 0),
    "home": (0, 1.1),
    "middle": (2, 1.1),
    "west": (0, 2.2),
    "points": (0.9, 2.2),
    "north": (2, 2.2),
    "east": (2.8, 2.2),
    "fork": (3.7, 2.2),
    "s1": (0.45, 3.3),
    "s2": (2, 3.3),
    "s3": (2.8, 3.3),
    "new": (3.7, 3.3),
}


def railway_pictures() -> dict[str, str]:
    """Return the junction with its mistakes, and the junction before and after the repairs."""
    engine = envgraph.open("railway")
    before = railway_picture(engine)
    for rule in (rule for rule in engine.rules if rule.startswith("railway.repair.")):
        while engine.exists(rule):
            engine.apply(rule)
    both = [(before, "five mistakes"), (railway_picture(engine), "after the repairs")]
    return {
        "railway.svg": tile(before, "Railway", "six queries for mistakes"),
        "railway-repairs.svg": sheet(both, "A railway junction before and after repairs", columns=1, size=400),
    }


def railway_picture(engine: envgraph.Engine) -> str:
    """Return a picture of the railway, in which the objects of mistakes have a red border."""
    picture = engine.model.picture(
        classes=["Route", "SwitchPosition", "TrackElement", "Sensor", "Semaphore"],
        attributes=["length", "currentPosition", "position", "signal"],
        labels=False,
        highlight=[
            match[name] for query, names in MISTAKES.items() for match in engine.matches(query) for name in names
        ],
    )
    return placed(picture, RAILWAY).to_svg(graphviz=False)


def placed(picture: Picture, places: Places) -> Picture:
    """Return a picture with boxes at the given places: the name of an object, its class, and the values alone."""
    nodes = []
    for node in picture.nodes:
        name, _, cls = node.title.partition(" : ")
        name, cls = (name, cls) if cls else ("new", name.partition("#")[0])  # rules create objects without a name
        values = (line.partition(" = ")[2] for line in node.lines)
        lines = (cls.replace("SwitchPosition", "wanted"), *values)
        mark = None if node.highlight_names is None else ()
        nodes.append(replace(node, title=name, lines=lines, place=places[name], highlight_names=mark))
    return replace(picture, nodes=tuple(nodes))


# --- social media: the circles of users who like a comment

SOCIAL_MEDIA: Places = {
    "hello": (0, 0),
    "riddle": (1, 1.2),
    "answer": (1, 2.4),
    "quiet": (2.4, 0),
    "dora": (0, 2.4),
    "ann": (0, 1.2),
    "ben": (2.4, 1.2),
    "cem": (2.4, 2.4),
}


CIRCLES: Places = {"ann": (0, 0), "ben": (1, 0), "cem": (2, 0), "dora": (1, 1)}


def social_media_pictures() -> dict[str, str]:
    """Return the model, and for each comment the users who like it, coloured by their circles."""
    engine = envgraph.open("social_media")
    whole = placed(engine.model.picture(attributes=[], labels=False), SOCIAL_MEDIA).to_svg(graphviz=False)
    scores = {match["comment"]: match["score"] for match in engine.matches("commentScore")}
    panels = [
        (circle_picture(engine, comment), f"{comment.object_name}: score {score}") for comment, score in scores.items()
    ]
    return {
        "social_media.svg": tile(whole, "Social Media", "posts, comments, friends"),
        "social_media-circles.svg": sheet(panels, "The circles of users who like a comment", columns=1, size=400),
    }


def circle_picture(engine: envgraph.Engine, comment: Node) -> str:
    """Return a picture of the users; those who like the comment have the colour and the size of their circle."""
    model, circles = engine.model, dict[str, list[str]]()
    for pair in engine.matches("circle", comment=comment):
        circles.setdefault(pair["one"].object_name, []).append(pair["other"].object_name)
    kinds = sorted({min(circle) for circle in circles.values()})
    users = [node for node in model if node.cls == "User"]
    boxes = [
        PictureNode(
            user.object_name,
            user.object_name,
            (f"circle of {len(circles[user.object_name])}",) if user.object_name in circles else ("no like",),
            FILL_COLOURS[kinds.index(min(circles[user.object_name]))] if user.object_name in circles else "#ffffff",
            place=CIRCLES[user.object_name],
        )
        for user in users
    ]
    friends = {tuple(sorted((user.object_name, friend.object_name))) for user in users for friend in user.friends}
    lines = [PictureEdge(one, other, "friends", head="none") for one, other in sorted(friends)]
    return Picture(comment.object_name, tuple(boxes), tuple(lines), "", "neato").to_svg(graphviz=False)


# --- assignment: features of a program before and after optimisation gives them classes

ASSIGNMENT: Places = {
    "reprice": (0, 0),
    "price": (1, 0),
    "discount": (2, 0),
    "lines": (1, 2),
    "total": (1, 1),
    "add": (0, 2),
    "reserve": (0, 3),
    "stock": (0, 4),
    "ship": (1, 3),
    "address": (1, 4),
    "pay": (2, 2),
    "balance": (2, 3),
}


def assignment_pictures() -> dict[str, str]:
    """Return the program without classes, and the program before and after the optimisation."""
    domain = Domain.load("assignment")
    before = assignment_picture(domain.engine())
    engine, _ = optimise_domain(domain)
    both = [(before, "without classes: 0"), (assignment_picture(engine), f"after 5,000 moves: {cra(engine):.4g}")]
    return {
        "assignment.svg": tile(before, "Assignment", "methods and classes"),
        "assignment-classes.svg": sheet(both, "A program before and after optimisation", columns=1, size=290),
    }


def cra(engine: envgraph.Engine) -> float:
    """Return the CRA index of the engine's model."""
    (match,) = engine.matches("craIndex")
    return float(match["index"])


def assignment_picture(engine: envgraph.Engine) -> str:
    """Return a picture of the methods and attributes, coloured by their classes."""
    features = [node for node in engine.model if node.cls in ("Method", "Attribute")]
    classes = [node for node in engine.model if node.cls == "Class"]
    boxes, lines = [], []
    for node in features:
        name, cls = node.object_name, node.isEncapsulatedBy
        title = f"{name}()" if node.cls == "Method" else name
        fill = FILL_COLOURS[classes.index(cls)] if cls else "#ffffff"
        boxes.append(PictureNode(name, title, (cls.name if cls else "no class",), fill, place=ASSIGNMENT[name]))
        if node.cls == "Method":
            used = [*node.dataDependency, *node.functionalDependency]
            lines += [PictureEdge(name, other.object_name) for other in used]
    return Picture("shop", tuple(boxes), tuple(lines), "", "neato").to_svg(graphviz=False)
