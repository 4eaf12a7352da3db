"""Temporal-difference learning of many learners, equal to that on lists (`_q_learning`, `_on_lists`) bit for bit.

The text of these functions is compiled behind those of `kernels` of compiled environments, which samples random
numbers with NumPy's PCG64, and of `_values`. The order of operations and each expression must be the same as in the
loops on lists.
"""

# ruff: noqa: F821
# mypy: ignore-errors

Q_LEARNING, SARSA, DOUBLE = 0, 1, 3


def next_value(row, actions, epsilon, side):
    """Return the value of the next observation; in double Q-learning `side` picks the action, the other rates it."""
    if AGENT == Q_LEARNING:
        return best_of(row, actions)
    if AGENT == DOUBLE:
        return row[actions - side + greedy(row, side, actions)]
    return mean_of(row, actions, epsilon)


def update_first(q, waiting, first, end, rate, discount, value):
    """Update the value of the first waiting step towards the waiting steps' rewards plus a discounted `value`."""
    seen, column, earned = waiting
    for step in range(end - 1, first - 1, -1):
        value = earned[step % N_STEP] + discount * value
    row, place = q[seen[first % N_STEP]], column[first % N_STEP]
    row[place] = row[place] + rate * (value - row[place])


def sample_place(cumulative, first, draw):
    found = 0
    while cumulative[first + found] <= draw:
        found += 1
    return found


def learn(arrays, values, rows, epsilons, factors, limit, points, waiting, curve):
    """Train each learner for a stage.

    Args:
        arrays: see `Table.arrays`.
        values: float64 [learners, observations, actions], or twice as many actions; changed.
        rows: uint64 [learners, 4], their random streams, advanced.
        epsilons: float64 [learners], changed.
        factors: see `Stage.factors`.
        limit: steps of an episode.
        points: int64, steps at which the curve is recorded; the last one is the end.
        waiting: space for the steps whose update waits in n-step learning: observations, columns and rewards.
        curve: for each learner and point the total reward, finished episodes and successes among them; written.
    """
    offset, next_state, following, rewards, terminated, cumulative, starts, start_seen, start_cumulative, shape = arrays
    rate, discount, step_decay, episode_decay, minimum = factors
    n_actions, n_outcomes = shape
    several = len(starts) > 1
    for learner in range(len(values)):
        q, epsilon = values[learner], epsilons[learner]
        start = sample_place(start_cumulative, 0, uniform(rows, learner)) if several else 0
        state, seen, left = starts[start], start_seen[start], limit
        point, total, episodes, successes = 0, 0.0, 0, 0
        first = 0  # of the steps that wait, up to the present one
        for step in range(1, points[-1] + 1):
            u = uniform(rows, learner)
            v = uniform(rows, learner) if n_outcomes > 1 else 0.0
            w = uniform(rows, learner) if several else 0.0
            action, free = drawn_action(q[seen], n_actions, u, epsilon, TIES)
            if AGENT == SARSA and step - 1 - first == N_STEP:
                update_first(q, waiting, first, step - 1, rate, discount, q[seen][action])
                first += 1
            at = offset[state * n_actions + action]
            if n_outcomes > 1:
                at += sample_place(cumulative, at, v)
            reward, state, after, ended = rewards[at], next_state[at], following[at], terminated[at]
            total += reward
            left -= 1
            side = n_actions if AGENT == DOUBLE and free >= 0.5 else 0
            cut = ended != 0 or left == 0 or step == points[-1]
            here = (step - 1) % N_STEP
            waiting[0][here], waiting[1][here], waiting[2][here] = seen, side + action, reward
            if cut or (AGENT != SARSA and step - first == N_STEP):
                value = next_value(q[after], n_actions, epsilon, side) if ended <= 0 else 0.0
                for _ in range(step - first if cut else 1):
                    update_first(q, waiting, first, step, rate, discount, value)
                    first += 1
            seen = after
            epsilon = max(minimum, epsilon * step_decay)
            if ended != 0 or left == 0:
                episodes += 1
                successes += ended == 1
                epsilon = max(minimum, epsilon * episode_decay)
                left = limit
                start = sample_place(start_cumulative, 0, w) if several else 0
                state, seen = starts[start], start_seen[start]
            if step == points[point]:
                curve[0][learner, point], curve[1][learner, point] = total, episodes
                curve[2][learner, point] = successes
                point += 1
        epsilons[learner] = epsilon


def play(arrays, values, rows, distance, limit, episodes, scores, successes):
    """Play episodes of each learner's greedy policy, and write the fields of `Judgement` into `scores` and `successes`.

    The other arguments are as for `learn`; `distance` is the number of steps from each state to success.
    """
    offset, next_state, following, _, terminated, cumulative, starts, start_seen, start_cumulative, shape = arrays
    n_actions, n_outcomes = shape
    for learner in range(len(values)):
        q, total, reached = values[learner], 0.0, 0
        for _ in range(episodes):
            start = sample_place(start_cumulative, 0, uniform(rows, learner)) if len(starts) > 1 else 0
            state, seen, ended, left = starts[start], start_seen[start], 0, limit
            first = nearest = distance[state]
            while ended == 0 and left > 0:
                at = offset[state * n_actions + greedy(q[seen], 0, n_actions)]
                if n_outcomes > 1:
                    at += sample_place(cumulative, at, uniform(rows, learner))
                state, seen, ended = next_state[at], following[at], terminated[at]
                left -= 1
                if ended == 0:
                    nearest = min(nearest, distance[state])
            reached += ended == 1
            total += 1.0 if ended == 1 else 0.25 * (1.0 - nearest / first)
        scores[learner], successes[learner] = total / episodes, reached / episodes
