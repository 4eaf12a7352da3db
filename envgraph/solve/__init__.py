"""What can be computed of environments whose tables are known, without training: certificates of families.

`certify` puts together what is known of an environment and of a policy in it: `shortest_plan`, `optimal_return`, and
what `evaluate_policy` expects of any policy. `cvar` is about the worst members of a family, `value_iteration` gives the
best policy without a time limit, and `chain_transfer` says how easily what is best in one environment finds success in
the next. `mixture` makes one environment of several.
"""

from envgraph.errors import shorten
from envgraph.solve._certificates import Certificates, certify, cvar, shortest_plan
from envgraph.solve._checker import recomputed
from envgraph.solve._distance import steps_to_success
from envgraph.solve._evaluation import Evaluation, evaluate, evaluate_policy
from envgraph.solve._mixture import mixture
from envgraph.solve._transfer import chain_transfer, hit_probability, reachable_states, softened_policy
from envgraph.solve._value_iteration import Optimum, optimal_episode, optimal_return, value_iteration

__all__ = [
    "Certificates",
    "Evaluation",
    "Optimum",
    "certify",
    "chain_transfer",
    "cvar",
    "evaluate",
    "evaluate_policy",
    "hit_probability",
    "mixture",
    "optimal_episode",
    "optimal_return",
    "reachable_states",
    "recomputed",
    "shortest_plan",
    "softened_policy",
    "steps_to_success",
    "value_iteration",
]

shorten(globals(), __all__)
