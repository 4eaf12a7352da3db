"""Compute properties of environments with known tables, without training, such as certificates of families.

`certify` collects what is known of an environment and of a policy in it: `shortest_plan`, `optimal_return`, and the
expected values of `evaluate_policy`. `sample_walks` needs no table. `cvar` is about the worst members of a family.
`value_iteration` computes the best policy without a time limit. `chain_transfer` measures how easily the best policy of
one environment finds success in the next. `mixture` combines several environments into one.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.solve._certificates import (
        Certificates as Certificates,
        certify as certify,
        cvar as cvar,
        shortest_plan as shortest_plan,
    )
    from envgraph.solve._checker import recomputed as recomputed
    from envgraph.solve._distance import steps_to_success as steps_to_success
    from envgraph.solve._episode_advisor import EpisodeAdvisor as EpisodeAdvisor
    from envgraph.solve._evaluation import (
        Evaluation as Evaluation,
        evaluate as evaluate,
        evaluate_policy as evaluate_policy,
    )
    from envgraph.solve._intervals import (
        bootstrap_interval as bootstrap_interval,
        interquartile_mean as interquartile_mean,
        newcombe_interval as newcombe_interval,
        performance_profile as performance_profile,
        probability_of_improvement as probability_of_improvement,
        wilson_interval as wilson_interval,
    )
    from envgraph.solve._mixture import mixture as mixture
    from envgraph.solve._sampling import sample_walks as sample_walks
    from envgraph.solve._transfer import (
        chain_transfer as chain_transfer,
        hit_probability as hit_probability,
        reachable_states as reachable_states,
        softened_policy as softened_policy,
    )
    from envgraph.solve._value_iteration import (
        OptimalPolicy as OptimalPolicy,
        optimal_episode as optimal_episode,
        optimal_return as optimal_return,
        value_iteration as value_iteration,
    )

export_lazily(globals())
