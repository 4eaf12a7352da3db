"""`envgraph import` of levels."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
import zlib
from pathlib import Path

import pytest

import envgraph as envgraph_env
from envgraph.env import scene_of, scene_text
from envgraph.errors import Source
from envgraph.lang import open_workspace
from envgraph.search import Domain, level_models, open_family
from tests.profile import NIGHTLY
from tests.unit.cli.test_commands import Envgraph, envgraph, ok

__all__ = ["envgraph"]

SOKOBAN = """\
; 1
####
# .#
#  ###
#*@  #
#  $ #
#  ###
####

#######
#.-$_@#
#######
Title: Corridor
Author: somebody
"""

TMX = """\
<map width="5" height="3"{infinite}>
 <tileset firstgid="1"><tile id="0" type="Wall"/><tile id="1" class="Floor"/></tileset>
 <layer><data encoding="{encoding}">
1,1,1,1,1,
1,2147483655,2,8,{last},
1,1,1,1,1
</data></layer>
 <layer><data encoding="csv">0,0,0,0,0, 0,0,9,0,0, 0,0,0,0,0</data></layer>
</map>
"""


def rows(path: str) -> list[str]:
    """The rows of the grid of a model."""
    text = Path(path).read_text(encoding="utf-8").split('"""')[1]
    return [line.strip() for line in text.strip().split("\n")]


def write(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")


def test_each_sokoban_level_is_written_as_a_model_into_the_domain(envgraph: Envgraph) -> None:
    write("boxes.xsb", SOKOBAN)
    done = ok(envgraph("import", "boxes.xsb"))
    assert done.out.splitlines()[-3:] == [
        "wrote boxes/boxes_1.model",
        "wrote boxes/boxes_2.model",
        "next: envgraph generate boxes --set model=boxes_1.model",
    ]
    assert rows("boxes/boxes_1.model")[1:5] == ["#_.#__", "#__###", "#*@__#", "#__$_#"]
    assert rows("boxes/boxes_2.model") == ["#######", "#.-$_@#".replace("-", "_"), "#######"]
    assert "// Corridor\nmodel boxes_2 : sokoban {" in Path("boxes/boxes_2.model").read_text(encoding="utf-8")
    engine = open_workspace("boxes/boxes_1.model", "boxes/sokoban.query").engine()
    assert (engine.count("box"), engine.count("goal"), engine.count("misplaced")) == (2, 2, 1)
    assert "no problems" in ok(envgraph("check", "boxes")).out


def test_levels_are_written_into_an_existing_domain_and_overwrite_nothing(envgraph: Envgraph) -> None:
    ok(envgraph("new", "mine", "--domain", "sokoban"))
    write("one.xsb", "#####\n#.$@#\n#####\n")
    done = ok(envgraph("import", "one.xsb", "-o", "mine", "--format", "json"))
    assert done.json == {"written": ["mine/one.model"]}
    again = envgraph("import", "one.xsb", "-o", "mine")
    assert again.code == 1 and "exists already; nothing was written" in again.err


def test_an_unknown_letter_is_reported_with_its_position_and_all_known_letters(envgraph: Envgraph) -> None:
    write("bad.xsb", "#####\n#.x@#\n#$ x#\n#####\n\n####\n#.?#\n####\n")
    done = envgraph("import", "bad.xsb")
    assert done.code == 1 and not Path("bad").exists()
    assert "bad.xsb:2:3: `x` has no meaning in the model\n 2 | #.x@#\n   |   ^\n" in done.err
    assert "bad.xsb:7:3: `?` has no meaning in the model" in done.err and done.err.count("`x` has no") == 1
    assert "are `#`, `_`, `.`, `$`, `*`, `@`, `+`; add `--legend" in done.err
    known = envgraph("import", "bad.xsb", "--legend", "x=_", "--legend", "?=$")
    assert "bad.xsb:6:1: cannot bind parameter `worker`: the model has no `Worker`" in known.err


def test_a_line_of_mostly_unknown_letters_next_to_a_level_is_an_error(envgraph: Envgraph) -> None:
    write("bad.xsb", "######\n#@ $.#\n#XYZ\n######\n\n::RLE\n5#\n#@$.#\n5#\n")
    done = envgraph("import", "bad.xsb")
    assert done.code == 1 and not Path("bad").exists()
    assert [line for line in done.err.splitlines() if line.startswith("bad.xsb")] == [
        f"bad.xsb:{line}:1: this line is next to a level, "
        "but at least half of its characters are not letters of the model"
        for line in (3, 7, 9)
    ]
    assert "run-length encoding" in done.err
    write("good.xsb", "Levels of #\n#####\n#@$.#\n#####\nTitle: first\n; second\n#####\n#.$@#\n#####\n\n#XY\n")
    ok(envgraph("import", "good.xsb"))
    assert Path("good/good_2.model").exists()


def test_model_errors_are_reported_at_the_cell_of_the_level(envgraph: Envgraph) -> None:
    Path("levels").mkdir()
    write("levels/bad.xsb", "; one\n#####\n#.$@#\n#####\n\n; two\n  ####\n###.@#\n#@$ #\n####\n")
    done = envgraph("import", "levels/bad.xsb")
    assert done.code == 1 and not Path("bad").exists()
    assert "levels/bad.xsb:9:2: cannot bind parameter `worker`: the model has 2 objects of class `Worker`" in done.err
    assert "note: levels/bad.xsb:8:5: object 1 is here" in done.err


@pytest.mark.parametrize(("entry", "said"), [("x=Q", "cannot mean `Q`"), ("x#", "not of the form NAME=LETTER")])
def test_invalid_legend_entries_are_refused(envgraph: Envgraph, entry: str, said: str) -> None:
    write("one.xsb", "#####\n#.$@#\n#####\n")
    done = envgraph("import", "one.xsb", "--legend", entry)
    assert done.code == 1 and said in done.err


@pytest.mark.parametrize("suffix", ["tmx", "tmj", "json"])
def test_layers_of_tiled_maps_are_merged(envgraph: Envgraph, suffix: str) -> None:
    layers = [
        [1, 1, 1, 1, 1, 1, 0x80000007, 2, 8, 1, 1, 1, 1, 1, 1],
        [0, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0],
    ]
    tiles = [{"id": 0, "type": "Wall"}, {"id": 1, "class": "Floor"}]
    value = {
        "width": 5,
        "height": 3,
        "layers": [{"type": "tilelayer", "data": one} for one in layers] + [{"type": "objectgroup"}],
        "tilesets": [{"firstgid": 1, "tiles": tiles}, {"firstgid": 9, "source": "other.tsx"}],
    }
    text = TMX.format(infinite="", encoding="csv", last=1) if suffix == "tmx" else json.dumps(value)
    write(f"map.{suffix}", text)
    legend = [part for entry in ("7=@", "8=.", "9=$") for part in ("--legend", entry)]
    ok(envgraph("import", f"map.{suffix}", *legend))
    assert rows("map/map.model") == ["#####", "#@$.#", "#####"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            TMX.format(infinite="", encoding="csv", last="1,1"),
            "map.tmx:3:10: the layer has 16 tiles, not 5 x 3",
        ),
        (TMX.format(infinite="", encoding="csv", last="one"), "map.tmx:5:18: `one` is not a tile number"),
        (TMX.format(infinite="", encoding="csv", last="1"), "map.tmx:5:3: `7` has no meaning in the model"),
        (TMX.format(infinite="", encoding="csv", last="9" * 5000), "9` is not a tile number"),
        (TMX.format(infinite="", encoding="csv", last="٣"), "`٣` is not a tile number"),
        (f'<map width="{"9" * 5000}" height="9"/>', "it has no `width` and `height`"),
        (TMX.format(infinite="", encoding="xml", last="1"), "the data of this layer is neither CSV nor base64"),
        (
            TMX.format(infinite="", encoding="base64", last="1"),
            "map.tmx:3:10: the data of this layer cannot be decoded: ",
        ),
        (
            TMX.format(infinite="", encoding='base64" compression="zstd', last="1"),
            "map.tmx:3:10: the data of this layer is compressed with `zstd`, which is not supported",
        ),
        (TMX.format(infinite=' infinite="1"', encoding="csv", last="1"), "infinite maps are not supported"),
        ('<map width="5" height="0"/>', "it has no `width` and `height`"),
        ('<map width="9999" height="9999"/>', "more than 100,000 cells"),
        ('<map width="9" height="9"/>', "the map has no tile layer"),
        ("<tileset/>", "map.tmx:1:2: this is not a map of Tiled"),
        ("<map", "is never closed"),
    ],
)
def test_unsupported_tmx_maps_are_refused_with_a_reason(envgraph: Envgraph, text: str, said: str) -> None:
    write("map.tmx", text)
    done = envgraph("import", "map.tmx")
    assert done.code == 1 and said in done.err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '{"layers": [{"type": "tilelayer", "data": "eJw=", "compression": "zlib"}], "width": 1, "height": 1}',
            "map.tmj:1:13: the layer has 0 tiles, not 1 x 1",
        ),
        ('{"layers": [{"type": "tilelayer", "data": "eJw="}], "width": 1, "height": 1}', "map.tmj:1:13: the data of"),
        ('{"layers": [{"type": "tilelayer", "data": 3}], "width": 1, "height": 1}', "is neither CSV nor base64"),
        ('{"layers": 3}', "this is not a map of Tiled"),
        ('{"layers": [], "width": "a", "height": 1}', "no `width` and `height`"),
        ('{"layers": [', "map.tmj:1"),
    ],
)
def test_unsupported_json_maps_are_refused_with_a_reason(envgraph: Envgraph, text: str, said: str) -> None:
    write("map.tmj", text)
    done = envgraph("import", "map.tmj")
    assert done.code == 1 and said in done.err


@pytest.mark.parametrize("suffix", ["tmx", "tmj"])
@pytest.mark.parametrize("compression", ["", "zlib", "gzip"])
def test_layers_in_base64_are_those_in_csv(envgraph: Envgraph, suffix: str, compression: str) -> None:
    tiles = struct.pack("<15I", 1, 1, 1, 1, 1, 1, 0x80000007, 9, 8, 1, 1, 1, 1, 1, 1)
    packed = {"": tiles, "zlib": zlib.compress(tiles), "gzip": gzip.compress(tiles)}
    text = base64.b64encode(packed[compression]).decode()
    value = {"type": "tilelayer", "encoding": "base64", "compression": compression, "data": text}
    written = {
        "tmj": json.dumps({"width": 5, "height": 3, "layers": [value]}),
        "tmx": f'<map width="5" height="3"><layer><data encoding="base64" compression="{compression}">\n  {text}\n'
        "</data></layer></map>",
    }
    write(f"map.{suffix}", written[suffix])
    legend = [part for entry in ("1=#", "7=@", "8=.", "9=$") for part in ("--legend", entry)]
    ok(envgraph("import", f"map.{suffix}", *legend))
    assert rows("map/map.model") == ["#####", "#@$.#", "#####"]


DES = """\
# A room.
MAZE: "boxes", ' '
GEOMETRY:center,center
INIT_MAP: solidfill, ' '
MAP
-----
|   |
-----
ENDMAP
BRANCH:(01,01,01,01),(0,0,0,0)
OBJECT:('`',"boulder"),(2,1)
STAIR:(3, 1),down
REGION:(0,0,4,2),lit,"ordinary"
"""
ROOM = [part for entry in ("-=#", "|=#", "BRANCH=@", "boulder=$", "down=.") for part in ("--legend", entry)]


def test_things_of_des_files_are_put_on_cells_of_their_map(envgraph: Envgraph) -> None:
    write("level.des", DES)
    done = ok(envgraph("import", "level.des", *ROOM))
    assert "wrote level/level.model" in done.out and rows("level/level.model") == ["#####", "#@$.#", "#####"]
    assert "// boxes\nmodel level" in Path("level/level.model").read_text(encoding="utf-8")
    assert "level.des:11:1: `boulder` has no meaning in the model" in envgraph("import", "level.des", *ROOM[:6]).err
    write("none.des", "MAZE: \"x\", ' '\n")
    assert "hint: write a map between `MAP` and `ENDMAP`" in envgraph("import", "none.des").err


def test_all_lines_of_a_des_file_that_are_not_understood_are_reported(envgraph: Envgraph) -> None:
    write(
        "level.des",
        "STAIR:(1,1),up\n" + DES + "  OBJECT:'%',random\nTRAP:\"pit\",(2,1)\nMONSTER:'Z',(5,1)\n"
        "INIT_MAP:mines,'.',' ',true\nROOM:\"ordinary\",lit,(3,3),(1,1),(5,5) {\nENDMAP\nMAP\n---\n",
    )
    done = envgraph("import", "level.des", *ROOM)
    assert done.code == 1 and not Path("level").exists()
    assert [line for line in done.err.splitlines() if line.startswith(("level.des", "note", "hint"))] == [
        "level.des:1:1: column 1, row 1 is not in a map before this line",
        "level.des:15:3: this line is not understood",
        hint := "hint: remove it, give it a fixed place as in `STAIR:(2,3),down`, or write its letter into the map",
        "level.des:16:1: a cell can have one thing",
        "note: level.des:12:1: the first thing is here",
        "hint: remove one of the lines",
        "level.des:17:1: column 5, row 1 is not in a map before this line",
        "level.des:18:1: this line is not understood",
        hint,
        "level.des:19:1: this line is not understood",
        hint,
        "level.des:20:1: this line is not understood",
        hint,
        "level.des:21:1: this map is never closed",
        "hint: write `ENDMAP` behind it",
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("@$.\n\n" * 5001, "levels.xsb:10001:1: up to this level the file has 5,001 levels and 15,003 cells"),
        (
            f"@$.\n\n{'#' * 1000}\n" * 101,
            "levels.xsb:150:1: up to this level the file has 51 levels and 100,003 cells",
        ),
        (
            "#" * 1000 + ("\n#" + " " * 998 + "#") * 999,
            "levels.xsb:1:1: up to this level the file has 1 levels",
        ),
    ],
)
def test_files_with_too_many_levels_or_cells_are_refused(envgraph: Envgraph, text: str, said: str) -> None:
    write("levels.xsb", text)
    done = envgraph("import", "levels.xsb")
    assert done.code == 1 and done.err.startswith(said) and "ENVGRAPH_LIMITS=10" in done.err
    assert not Path("levels").exists()


def test_at_most_a_hundred_errors_of_levels_are_reported(envgraph: Envgraph) -> None:
    for wrong, said in (
        ("#x$.#\n\n", "`x` has no meaning in the model"),
        ("#@@.#\n\n", "cannot bind parameter `worker`"),
    ):
        write("levels.xsb", "#@$.#\n\n" * 3 + wrong * 120)
        done = envgraph("import", "levels.xsb")
        assert done.code == 1 and done.err.count(said) == 100
        assert not Path("levels").exists()


def test_a_file_without_levels_and_a_domain_without_a_grid_are_refused(envgraph: Envgraph) -> None:
    write("note.txt", "Nothing to see.\n")
    assert "note.txt:1:1: the file has no level" in envgraph("import", "note.txt").err
    assert "no grid whose rows" in envgraph("import", "note.txt", "--domain", "network").err


COLLECTION = {
    "levels/b.xsb": "; far\n#######\n#@ $ .#\n#######\n\n; near\n#####\n#@$.#\n#####\n",
    "levels/more/a.sok": "#####\n#@$.#\n#####\n\n#####\n# $.#\n#####\n\n######\n#@$..#\n######\n",
    "levels/b-1.txt": "#####\n#.$@#\n#####\n",
    "levels/notes.md": "These are levels.\n",
}


def write_collection() -> None:
    Path("levels/more").mkdir(parents=True)
    for name, text in COLLECTION.items():
        write(name, text)


def test_a_directory_of_levels_becomes_a_family_in_the_order_of_its_measure(envgraph: Envgraph) -> None:
    write_collection()
    done = ok(envgraph("import", "levels", "--to", "family", "--domain", "sokoban"))
    assert "3 of 6 levels; next: envgraph verify runs/levels\n" in done.out
    family = open_family("levels")
    models = [family.model(member) for member in family.members]
    assert [(member.name, member.individual, member.measures) for member in family.members] == [
        ("E1", 0, {"plan": 1.0}),
        ("E2", 2, {"plan": 1.0}),
        ("E3", 1, {"plan": 3.0}),
    ]
    assert [model.name for model in models] == ["b_1", "b_2", "b_1_"]
    assert not any(member.initial for member in family.members)
    assert [line for line in done.err.splitlines() if line.startswith(("levels/", "note"))] == [
        "levels/more/a.sok:1:1: warning: the level is left out: it equals another one [left-out]",
        "note: levels/b.xsb:7:1: the other level is here",
        "levels/more/a.sok:5:1: warning: the level is left out: cannot bind parameter `worker`: the model has no "
        "`Worker` [left-out]",
        "levels/more/a.sok:9:1: warning: the level is left out: `forbid unbalanced` is violated [left-out]",
    ]
    again = envgraph("import", "levels", "--to", "family")
    assert again.code == 1 and "runs/levels/run.sqlite exists already" in again.err
    table = ok(envgraph("verify", "levels")).out
    assert [row.split()[2] for row in table.splitlines()[2:5]] == ["1", "1", "3"]
    envs = envgraph_env.make_vec("levels", 6)
    assert envs.reset(seed=0)[0].shape == (6,)
    (reason,) = [one for one in ok(envgraph("show", "levels", "--rejections")).out.splitlines() if "unbalanced" in one]
    assert reason.split() == ["1", "33%", "`forbid", "unbalanced`", "is", "violated"]


def test_settings_of_the_domain_can_be_changed_for_a_family_of_levels(envgraph: Envgraph) -> None:
    write("one.xsb", "#####\n#@$.#\n#####\n")
    ok(envgraph("import", "one.xsb", "--to", "family", "--name", "small", "--set", 'measures.plan.kind="count"',
                "--set", 'measures.plan.of="goal"', "--set", 'constraints={}'))  # fmt: skip
    assert [member.measures for member in open_family("small").members] == [{"plan": 1.0}]
    assert "--to family" in envgraph("import", "one.xsb", "--set", "seed=3").err
    assert "use `--name`" in envgraph("import", "one.xsb", "--to", "family", "-o", "small").err


def test_levels_without_a_known_plan_stay_in_a_family(envgraph: Envgraph) -> None:
    write("two.xsb", "#####\n#$@.#\n#####\n\n#####\n#@$.#\n#####\n")
    ok(envgraph("import", "two.xsb", "--to", "family"))
    assert [member.measures["plan"] for member in open_family("two").members] == [1.0, 1000.0]
    ok(envgraph("import", "two.xsb", "--to", "family", "--domain", "sokoban", "--force"))
    assert [member.measures["plan"] for member in open_family("two").members] == [1.0]


def test_a_family_without_a_valid_level_is_refused(envgraph: Envgraph) -> None:
    write("bad.xsb", "#####\n# $.#\n#####\n\n######\n#@$..#\n######\n")
    done = envgraph("import", "bad.xsb", "--to", "family")
    assert done.code == 1 and not Path("runs").exists()
    assert "bad.xsb:1:1: the level is left out: cannot bind parameter `worker`" in done.err
    assert "bad.xsb:5:1: the level is left out: `forbid unbalanced` is violated" in done.err


def test_all_files_of_a_directory_have_to_have_levels(envgraph: Envgraph) -> None:
    write_collection()
    write("levels/LICENSE.txt", "Free.\n")
    write("levels/c.xsb", "#####\n#?$.#\n#####\n")
    write("levels/d.des", "MAP\n#@$.#\nENDMAP\nLOOP\n")
    done = envgraph("import", "levels", "--to", "family")
    assert done.code == 1 and not Path("runs").exists()
    assert "levels/LICENSE.txt:1:1: the file has no level" in done.err
    assert "levels/d.des:4:1: this line is not understood" in done.err
    for name in ("LICENSE.txt", "d.des"):
        Path("levels", name).unlink()
    assert "levels/c.xsb:2:2: `?` has no meaning" in envgraph("import", "levels", "--to", "family").err
    Path("empty").mkdir()
    assert "`empty` has no file of levels" in envgraph("import", "empty", "--to", "family").err
    published = envgraph("import", "family.json", "--to", "models")
    assert published.code == 1 and "only levels become models" in published.err


def test_levels_of_different_sizes_have_the_same_observations(envgraph: Envgraph) -> None:
    write("sizes.xsb", "#####\n#@$.#\n#####\n\n" + "#" * 9 + "\n#@  $  .#\n#       #\n" + "#" * 9 + "\n")
    ok(envgraph("import", "sizes.xsb", "--to", "family", "--domain", "sokoban/levels.toml"))
    small, large = (envgraph_env.make("sizes", variant=number) for number in (1, 2))
    assert small.observation_space == large.observation_space


ID = re.compile(r"(?<=^Key) [0-9]+(?=[,:])")
GRIDS = ("burning_forest", "keydoor", "lava", "sokoban", "taxi", "warehouse")


def picture(domain: str) -> str:
    found = Domain.load(domain)
    assert found.behaviour is not None and found.behaviour.draw is not None
    return scene_text(scene_of(found.initial(), found.behaviour.draw, found.behaviour.parameters))


@pytest.mark.parametrize("domain", GRIDS)
def test_a_picture_of_a_grid_is_read_back(envgraph: Envgraph, domain: str) -> None:
    write("picture.txt", picture(domain) + "\n")
    ok(envgraph("import", "picture.txt", "--domain", domain))
    found = Domain.load("picture", overrides=["model=picture.model"])
    assert found.behaviour is not None and found.behaviour.draw is not None
    assert scene_text(scene_of(found.initial(), found.behaviour.draw, found.behaviour.parameters)) == picture(domain)


@pytest.mark.parametrize("domain", GRIDS)
def test_pictures_of_a_random_walk_are_read_back_or_refused(domain: str) -> None:
    found, read, steps = Domain.load(domain), 0, 12 if NIGHTLY else 6
    assert found.behaviour is not None and found.behaviour.draw is not None
    env = envgraph_env.make(domain=domain, render_mode="ansi")
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(steps):
        text = env.render()
        assert isinstance(text, str)
        (level,) = level_models([("picture", Source("picture.txt", text))], found, {})
        assert {one.code for one in level.problems} <= {"bad-picture"}
        if not level.problems:
            read += 1
            assert level.model is not None
            again = scene_text(scene_of(level.model, found.behaviour.draw, found.behaviour.parameters))
            assert [ID.sub("", line) for line in again.split("\n")] == [ID.sub("", line) for line in text.split("\n")]
        if any(env.step(env.action_space.sample())[2:4]):
            env.reset()
    assert read >= {"lava": steps // 6, "taxi": 0}.get(domain, steps - 2)


def test_a_picture_says_what_lies_below_a_mark(envgraph: Envgraph) -> None:
    text = " #  #  #  #\n #  . (@) #\n # ($)($) #\nFloor 2, 1, box: column 1, row 2\nGoal 2, 2, box: column 2, row 2\n"
    write("boxes.txt", f"; two boxes\n{text}worker: column 2, row 1\n\nE4  plan 3\n{text}worker: column 2, row 1\n")
    ok(envgraph("import", "boxes.txt"))
    assert rows("boxes/boxes_1.model") == rows("boxes/boxes_2.model") == ["####", "#.@#", "#$*#"]
    assert "// E4  plan 3\nmodel boxes_2" in Path("boxes/boxes_2.model").read_text(encoding="utf-8")


def test_a_token_outside_of_the_grid_is_moved(envgraph: Envgraph) -> None:
    write("forest.txt", picture("burning_forest").replace("(F) V ", " S (F)"))
    ok(envgraph("import", "forest.txt", "--domain", "burning_forest"))
    assert "currentState = tile[1, 0]" in Path("forest/forest.model").read_text(encoding="utf-8")
    assert rows("forest/forest.model")[0][0] == "S"


@pytest.mark.parametrize(
    ("domain", "old", "new", "said"),
    [
        (
            "lava",
            "(>)",
            "(v)",
            "2:1: this line cannot be read: the model would be drawn with ` # (>) .",
        ),
        ("lava", "Key red: nowhere", "Key red: column 1, row 2", "9:1: this line cannot be read"),
        ("keydoor", "hero: column 1", "hero: column 99", "2:4: `H` has no meaning in the model"),
        ("keydoor", "hero: column 1, row 1", "", "2:4: `H` has no meaning in the model"),
        ("sokoban", "(@)", "(?)", "2:1: this line cannot be read"),
        ("sokoban", " _  _  _  _  _  #", " _  ?  _  _  _  #", "6:7: `?` has no meaning in the model"),
    ],
)
def test_a_line_of_a_picture_that_cannot_be_read_is_an_error(
    envgraph: Envgraph, domain: str, old: str, new: str, said: str
) -> None:
    write("picture.txt", picture(domain).replace(old, new, 1) + "\n")
    done = envgraph("import", "picture.txt", "--domain", domain)
    assert done.code == 1 and not Path("picture").exists()
    assert f"picture.txt:{said}" in done.err


def test_a_mistyped_row_among_pictures_is_an_error(envgraph: Envgraph) -> None:
    text = picture("sokoban") + "\n"
    write("pictures.txt", text + "\n" + text.replace(" #  _  _  .", " #  _ _  .") + "\nOther text.\n")
    done = envgraph("import", "pictures.txt")
    assert done.code == 1 and "pictures.txt:15:1: this line is not part of the picture around it" in done.err
