"""Coins on a table, for what the Burning Forest does not have: chance, values, creation, missing objects."""

from __future__ import annotations

from collections.abc import Mapping

from envgraph.env import Behaviour, Simulator, Tabular, explore
from envgraph.lang import TextFiles, load_workspace
from envgraph.rewrite import Engine

METAMODEL = """
metamodel coins
enum Side { heads, tails }
class Table { contains Coin[0..*] coins  contains Hand[1] hand  contains Mark[0..*] marks }
@key(name)
class Coin {
    string name
    int value = 1
    Side side
    refers Coin[0..1] over
}
class Hand { refers Coin[0..1] holds  int moves = 0 }
class Mark { refers Hand[1] by }
"""

MODEL = """
import "coins.metamodel"
model three : coins {
    table : Table {
        hand = hand : Hand {}
        coins = [
            b : Coin { name = "b", value = 2 },
            a : Coin { name = "a", value = 1 },
            c : Coin { name = "c", value = 4, side = ::tails },
        ]
    }
}
"""

QUERY = """
package coins
import "coins.metamodel"
pattern up(coin : Coin) { Coin.side(coin, Side::heads); }
pattern down(coin : Coin) { Coin.side(coin, Side::tails); }
pattern worth(coin : Coin, value : int) { Coin.value(coin, value); find up(coin); }
pattern pair(one : Coin, other : Coin) { find up(one); find up(other); one != other; }
pattern held(hand : Hand, coin : Coin) { Hand.holds(hand, coin); }
pattern any(hand : Hand) { Hand(hand); }
"""

RULES = """
package coins
import "coins.query"
rule turn { lhs { coin : Coin; find up(coin); } modify { set coin.side = ::tails; } }
rule turnBack(coin : Coin) { lhs { find down(coin); } modify { set coin.side = ::heads; } }
rule turnOver(coin : Coin) { lhs { find up(coin); } modify { set coin.side = ::tails; } }
rule grab(hand : Hand, coin : Coin, out value : int) {
    lhs { Coin.value(coin, value); }
    not { hand -holds-> coin; }
    modify { set hand.holds = coin; }
}
rule drop(hand : Hand) { lhs { hand -holds-> coin : Coin; } modify { delete hand -holds-> coin; } }
rule lose(coin : Coin) { lhs { table : Table -coins-> coin; } modify { delete coin; } }
rule mint(table : Table, out fresh : Coin) {
    lhs { check true; }
    modify { create table -coins-> fresh : Coin { name = "new", value = 8 }; }
}
rule count(hand : Hand, by : int) { lhs { check hand.moves < 3; } modify { set hand.moves = hand.moves + by; } }
rule stack(one : Coin, other : Coin) { lhs { check true; } modify { create one -over-> other; } }
"""


PARAMETERS = "hand : Hand, table : Table"


def loaded(
    environment: str, parameters: str = PARAMETERS, texts: Mapping[str, str] | None = None
) -> tuple[Engine, Behaviour]:
    """The coins with the clauses of an environment; `texts` replaces files."""
    head = f'import "coins.query"\nimport "coins.rules"\nenvironment Coins({parameters}) {{\n'
    files = {
        "coins.metamodel": METAMODEL,
        "coins.model": MODEL,
        "coins.query": QUERY,
        "coins.rules": RULES,
        "coins.environment": f"{head}{environment}\n}}\n",
        **(texts or {}),
    }
    workspace = load_workspace(["coins.model", "coins.environment"], files=TextFiles(files))
    return workspace.engine(), workspace.behaviour()


def table(environment: str, limit: int = 1000) -> Tabular:
    tabular = explore(*loaded(environment), limit=limit).tabular
    tabular.check()
    return tabular


def simulator(environment: str, parameters: str = PARAMETERS) -> Simulator:
    return Simulator(*loaded(environment, parameters))


def sides(engine: Engine) -> str:
    """Which coins show heads, by name: "ab"."""
    coins = sorted((coin.name, coin.side) for coin in engine.model.nodes("Coin"))
    return "".join(name for name, side in coins if side == "heads")
