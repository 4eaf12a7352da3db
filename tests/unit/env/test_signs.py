"""What is to be reached, drawn as a sign of what is to come there."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from envgraph.env import ImageView, Mark, Simulator, legend, scene_of, scene_text
from envgraph.errors import LoadError
from envgraph.lang import bundled_domain, load_workspace
from envgraph.search import Domain


def test_destination_sign_has_its_own_letter_in_the_colour_of_the_passenger() -> None:
    domain = Domain.load("taxi")
    behaviour, model = domain.behaviour, domain.initial()
    assert behaviour is not None and behaviour.draw is not None
    scene = scene_of(model, behaviour.draw, behaviour.parameters)
    (sign,) = [mark for mark in scene.marks if mark.letter == "X"]
    assert sign == Mark("passenger, destination street", "X", "#c2255c", (0, 4), "Passenger, destination street")
    assert scene_text(scene).splitlines()[4].startswith("(X)")
    assert {"Passenger", "Passenger, destination street"} <= {key.kind for key in legend([scene])}


def test_image_observation_contains_objects_but_no_destination_signs() -> None:
    domain = Domain.load("taxi")
    assert domain.behaviour is not None
    simulator = Simulator(domain.engine(), domain.behaviour)
    view = ImageView(domain.behaviour, [domain.initial()])
    assert view.channels.count("Passenger") == 1
    plane = view.observe(simulator)[..., view.channels.index("Passenger")]
    assert np.argwhere(plane).tolist() == [[0, 0]]


def test_sign_of_more_than_one_letter_is_refused(tmp_path: Path) -> None:
    copytree(bundled_domain("taxi"), tmp_path / "mine")
    file = tmp_path / "mine" / "taxi.environment"
    file.write_text(file.read_text("utf-8").replace('as "X"', 'as "XY"'))
    with pytest.raises(LoadError, match="the letter of `passenger` must be a single character"):
        load_workspace([str(file)]).raise_errors()
