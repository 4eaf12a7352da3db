"""Temporal-difference learning of learners side by side, each as on lists (`_q_learning`, `_sarsa`), bit for bit.

The text of these functions stands behind that of `_kernels` of compiled environments, which draws the numbers: NumPy's
PCG64. Nothing may be reordered without the loop on lists, and each expression is as it stands there.
"""

# ruff: noqa: F821
# mypy: ignore-errors


def greedy_action(q, seen):
    action = 0
    for other in range(1, q.shape[1]):
        if q[seen, other] > q[seen, action]:
            action = other
    return action


def best_value(q, seen):
    """The value of the greedy action: a chain of maxima, which is quicker than finding the action first."""
    best = q[seen, 0]
    for other in range(1, q.shape[1]):
        best = max(best, q[seen, other])
    return best


def expected_value(q, seen, epsilon):
    """The value of what an agent does that explores so often."""
    total = 0.0
    for action in range(q.shape[1]):
        total += q[seen, action]
    return (1.0 - epsilon) * best_value(q, seen) + epsilon * (total / q.shape[1])


def drawn_place(cumulative, first, draw):
    found = 0
    while cumulative[first + found] <= draw:
        found += 1
    return found


def learn(arrays, values, rows, epsilons, factors, limit, points, curve):
    """One stage of each learner.

    Args:
        arrays: see `Table.arrays`.
        values: float64 [learners, observations, actions], changed.
        rows: uint64 [learners, 4], their streams, advanced.
        epsilons: float64 [learners], changed.
        factors: see `Stage.factors`.
        limit: steps of an episode.
        points: int64, steps at which the curve is read; the last one is the end.
        curve: of each learner and point the total reward, finished episodes and successes among them; written.
    """
    (
        offset,
        next_state,
        following,
        rewards,
        terminated,
        cumulative,
        starts,
        start_seen,
        start_cumulative,
        shape,
    ) = arrays
    agent, rate, discount, step_decay, episode_decay, minimum = factors
    n_actions, n_outcomes = shape
    several = len(starts) > 1
    for learner in range(len(values)):
        q, epsilon = values[learner], epsilons[learner]
        start = drawn_place(start_cumulative, 0, uniform(rows, learner)) if several else 0
        state, seen, left = starts[start], start_seen[start], limit
        point, total, episodes, successes = 0, 0.0, 0, 0
        pending, chosen, earned = -1, 0, 0.0  # a step of SARSA whose value waits for the next action
        for step in range(1, points[-1] + 1):
            u = uniform(rows, learner)
            v = uniform(rows, learner) if n_outcomes > 1 else 0.0
            w = uniform(rows, learner) if several else 0.0
            if u < epsilon:
                action = int(u / epsilon * n_actions)
            else:
                action = greedy_action(q, seen)
            if pending >= 0:
                old = q[pending, chosen]
                q[pending, chosen] = old + rate * (earned + discount * q[seen, action] - old)
                pending = -1
            at = offset[state * n_actions + action]
            if n_outcomes > 1:
                at += drawn_place(cumulative, at, v)
            reward, state, after, ended = rewards[at], next_state[at], following[at], terminated[at]
            total += reward
            left -= 1
            if agent == 1 and ended == 0 and left > 0 and step < points[-1]:
                pending, chosen, earned = seen, action, reward
            else:
                target = reward
                if ended <= 0:
                    following_value = (
                        best_value(q, after) if agent == 0 else expected_value(q, after, epsilon)
                    )
                    target = reward + discount * following_value
                old = q[seen, action]
                q[seen, action] = old + rate * (target - old)
            seen = after
            epsilon = max(minimum, epsilon * step_decay)
            if ended != 0 or left == 0:
                episodes += 1
                successes += ended == 1
                epsilon = max(minimum, epsilon * episode_decay)
                left = limit
                start = drawn_place(start_cumulative, 0, w) if several else 0
                state, seen = starts[start], start_seen[start]
            if step == points[point]:
                curve[0][learner, point], curve[1][learner, point] = total, episodes
                curve[2][learner, point] = successes
                point += 1
        epsilons[learner] = epsilon


def play(arrays, values, rows, distance, limit, episodes, scores, successes):
    """Episodes of each learner's greedy policy; arguments as in `learn`, results as in `Learners.play`."""
    offset, next_state, following, _, terminated, cumulative, starts, start_seen, start_cumulative, shape = (
        arrays
    )
    n_actions, n_outcomes = shape
    for learner in range(len(values)):
        q, total, reached = values[learner], 0.0, 0
        for _ in range(episodes):
            start = drawn_place(start_cumulative, 0, uniform(rows, learner)) if len(starts) > 1 else 0
            state, seen, ended, left = starts[start], start_seen[start], 0, limit
            first = nearest = distance[state]
            while ended == 0 and left > 0:
                at = offset[state * n_actions + greedy_action(q, seen)]
                if n_outcomes > 1:
                    at += drawn_place(cumulative, at, uniform(rows, learner))
                state, seen, ended = next_state[at], following[at], terminated[at]
                left -= 1
                if ended == 0:
                    nearest = min(nearest, distance[state])
            reached += ended == 1
            total += 1.0 if ended == 1 else 0.25 * (1.0 - nearest / first)
        scores[learner], successes[learner] = total / episodes, reached / episodes
