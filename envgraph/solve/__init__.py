"""What can be computed of environments whose tables are known, without training: certificates of families.

`value_iteration` gives the best policy, `evaluate_policy` the expected values of any, `hit_probability` how likely it
meets success within a time, and `chain_transfer` how easily what is best in one environment finds success in the next.
"""

from envgraph.errors import shorten
from envgraph.solve._evaluation import Evaluation, accumulate, evaluate, evaluate_policy
from envgraph.solve._transfer import chain_transfer, hit_probability, softened_policy
from envgraph.solve._value_iteration import Optimum, greedy_return, value_iteration

__all__ = [
    "Evaluation",
    "Optimum",
    "accumulate",
    "chain_transfer",
    "evaluate",
    "evaluate_policy",
    "greedy_return",
    "hit_probability",
    "softened_policy",
    "value_iteration",
]

shorten(globals(), __all__)
