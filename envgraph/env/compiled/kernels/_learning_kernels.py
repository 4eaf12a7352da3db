"""Code that is added to a program to learn action values with a hash table, for any number of states.

Part of the program's text, between `values` and `_playing`. `COUNTS` holds the step, the point of the curve, the
number of known keys, the current key, steps left, episodes, successes, 1 if an episode has begun, and the key and
action of a pending update. `LEVELS` holds the exploration rate, the total reward, and the reward of that update.
"""

# ruff: noqa: F821
# mypy: ignore-errors

DONE, SPACE, WRONG = 0, 1, 2
"""Results of learning: all steps are done, the keys need more space, or an error occurred in the environment."""
OUTCOMES, STARTS = 1, 2
"""Bits of `DRAWS`: random numbers to draw besides that for the choice of the action."""


def write_key(S, BITS, KEYS, row, seen, of_states):
    """Write the key of the current state into a row of `KEYS`: the state if `of_states`, else the observation."""
    if of_states:
        for column in range(width(S)):
            KEYS[row, column] = S[0, column]
        for column in range(width(BITS)):
            KEYS[row, width(S) + column] = BITS[0, column]
    else:
        KEYS[row, 0] = seen


def begin_episode(T, G, L, K, S, F, BITS, RI, RF, D, m, S0, F0, C, KEYS, NONE, HASHED, count, of_states):
    """Put the environment into a start state, sampled with `D`.

    Return the number of the key of that state or its observation, as `current_key` does; -1 after an error.
    """
    reset_one(T, G, L, K, S, F, RI, RF, D, 0, m, S0, F0)
    return current_key(T, G, L, K, S, F, BITS, RI, RF, D, m, C, KEYS, NONE, HASHED, count, of_states)


def current_key(T, G, L, K, S, F, BITS, RI, RF, D, m, C, KEYS, NONE, HASHED, count, of_states):
    """Return the number of the current state's key. Add a new key as number `count`. Return -1 after an error."""
    seen = 0
    if S[0, 0] == 0 and not of_states:
        seen = look(T[m], G[m], L, K, S[0], F[0], RI, RF, D, 0, C[0])
    if S[0, 0] != 0:
        return -1
    write_key(S, BITS, KEYS, count, seen, of_states)
    return number_of(KEYS, NONE, HASHED, count)


def learn(
    T, G, L, S, F, BITS, RI, RF, D, m, S0, F0, R, C, KEYS, HASHED, Q, INITIAL, OF_STATES, DRAWS,
    AGENT, TIES, RATE, DISCOUNT, STEP_DECAY, EPISODE_DECAY, MINIMUM, LIMIT,
    POINTS, REWARDS, EPISODES, SUCCESSES, COUNTS, LEVELS,
):  # fmt: skip
    """Continue learning up to the last step in `POINTS`, and update `Q`, the curve, `COUNTS` and `LEVELS`.

    Returns `DONE`, or `SPACE` to be called again with more space for keys, or `WRONG` after an error.
    """
    T, G, L, S, F, BITS = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(BITS)
    RI, RF, D, R, C = matrix(RI), matrix(RF), vector(D), matrix(R), matrix(C)
    S0, F0, NONE, KEYS, space = fixed(S0), fixed(F0), matrix(KEYS[:, :0]), matrix(KEYS), len(KEYS)
    K = places(L)
    step, point, count, key, left, episodes, successes = COUNTS[:7]
    epsilon, total, actions = LEVELS[0], LEVELS[1], Q.shape[1]
    how = DONE
    if COUNTS[7] == 0:
        D[0] = uniform(R, 0) if DRAWS & STARTS else 0.0
        key = begin_episode(T, G, L, K, S, F, BITS, RI, RF, D, m, S0, F0, C, KEYS, NONE, HASHED, count, OF_STATES)
        if key < 0:
            return WRONG
        if key == count:
            Q[key] = INITIAL
            count += 1
        COUNTS[7] = 1
    while step < POINTS[-1]:
        if count + 2 >= space:
            how = SPACE
            break
        u = uniform(R, 0)
        v = uniform(R, 0) if DRAWS & OUTCOMES else 0.0
        w = uniform(R, 0) if DRAWS & STARTS else 0.0
        action, _ = drawn_action(Q[key], actions, u, epsilon, TIES)
        if COUNTS[8] >= 0:  # SARSA: the update of the previous step needs this action
            old = Q[COUNTS[8], COUNTS[9]]
            Q[COUNTS[8], COUNTS[9]] = old + RATE * (LEVELS[2] + DISCOUNT * Q[key, action] - old)
            COUNTS[8] = -1
        D[0] = v
        reward, ended, _ = step_one(T[m], G[m], L, K, S[0], F[0], RI, RF, D, 0, action)
        following = -1
        if S[0, 0] == 0 and ended <= 0:
            following = current_key(T, G, L, K, S, F, BITS, RI, RF, D, m, C, KEYS, NONE, HASHED, count, OF_STATES)
        if S[0, 0] != 0:
            return WRONG
        if following == count:
            Q[following] = INITIAL
            count += 1
        total += reward
        left -= 1
        if AGENT == 1 and ended == 0 and left > 0 and step + 1 < POINTS[-1]:
            COUNTS[8], COUNTS[9], LEVELS[2] = key, action, reward
        else:
            target = reward
            if ended <= 0:
                target = reward + DISCOUNT * (
                    best_of(Q[following], actions) if AGENT == 0 else mean_of(Q[following], actions, epsilon)
                )
            Q[key, action] = Q[key, action] + RATE * (target - Q[key, action])
        key = following
        epsilon = max(MINIMUM, epsilon * STEP_DECAY)
        if ended != 0 or left == 0:
            episodes += 1
            successes += ended == 1
            epsilon = max(MINIMUM, epsilon * EPISODE_DECAY)
            left = LIMIT
            D[0] = w
            key = begin_episode(T, G, L, K, S, F, BITS, RI, RF, D, m, S0, F0, C, KEYS, NONE, HASHED, count, OF_STATES)
            if key < 0:
                return WRONG
            if key == count:
                Q[key] = INITIAL
                count += 1
        step += 1
        if step == POINTS[point]:
            REWARDS[point], EPISODES[point], SUCCESSES[point] = total, episodes, successes
            point += 1
    COUNTS[0], COUNTS[1], COUNTS[2], COUNTS[3] = step, point, count, key
    COUNTS[4], COUNTS[5], COUNTS[6] = left, episodes, successes
    LEVELS[0], LEVELS[1] = epsilon, total
    return how


def decide(T, G, L, K, S, F, BITS, RI, RF, D, m, R, C, POLICY):
    """Return the greedy action, -1 after an error; and False, since no random number was drawn.

    An unknown key has equal values, so its best action is 0. Its entry in the hash table is removed again.
    """
    KEYS, HASHED, Q, OF_STATES, count = POLICY
    NONE, KEYS = matrix(KEYS[:, :0]), matrix(KEYS)
    key = current_key(T, G, L, K, S, F, BITS, RI, RF, D, m, C, KEYS, NONE, HASHED, count, OF_STATES)
    if key < 0:
        return -1, False
    if key == count:
        forget(KEYS, NONE, HASHED, count)
        return 0, False
    return greedy(Q[key], 0, Q.shape[1]), False
