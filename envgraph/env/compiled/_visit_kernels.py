"""Code that is added to a program to visit all its states, with all choices.

Part of the program's text, behind `kernels` and `_scripted_choices`. Functions that are called from
outside get arrays, and convert them to vectors and matrices.
"""

# ruff: noqa: F821
# mypy: ignore-errors

DONE, SPACE, WRONG, MANY, FOUND, PAUSED = 0, 1, 2, 3, 4, 5
"""Results of a visit: all is done, arrays are full, an error of the environment, too many outcomes of an action, the
wanted end is found, or as many outcomes as were wanted are made."""


def add_state(T, G, L, K, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, row, over):
    """Return the number of the state in a row: that of an equal state, or `row` for a new state, which is observed.

    Returns -1 if the observation of a new state has no value. `over` is 1 if the state ends the episode.
    """
    S[row, 0] = over
    found = number_of(S, BITS, HASHED, row)
    if found == row:
        S[row, 0] = 0
        OBS[row] = look(T[m], G[m], L, K, S[row], F[row], RI, RF, D, 0, C[row])
        if S[row, 0] != 0:
            return -1
        S[row, 0] = over
    return found


def visit_starts(T, G, L, S, F, RI, RF, D, m, S0, F0, BITS, HASHED, C, OBS, TO, P):
    """Visit the states in which an episode may begin. Return how it ended, and the numbers of states and outcomes."""
    count, used, space = 0, 0, len(S)
    T, G, L, S, F, RI, RF = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(RI), matrix(RF)
    S0, F0, BITS, C = fixed(S0), fixed(F0), matrix(BITS), matrix(C)
    K = places(L)
    begin_script(D)
    while True:
        if count + 1 >= space or used >= len(TO):
            return SPACE, count, used
        begin_outcome(D)
        reset_one(T, G, L, K, S, F, RI, RF, D, count, m, S0, F0)
        if S[count, 0] != 0 or is_script_full(D):
            return WRONG, count, used
        chance = D[CHANCE]
        found = add_state(T, G, L, K, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, count, 0)
        if found < 0:
            return WRONG, count, used
        count += found == count
        TO[used], P[used] = found, chance
        used += 1
        if not next_script(D):
            return DONE, count, used


def visit(
    T, G, L, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, head, count, used, made, ACTIONS, MOST, LIMIT, WANTED,
    STARTS, TO, P, REWARD, END, DID,
):  # fmt: skip
    """Do every action in each state, in the order of the states' numbers. New states get the next numbers.

    `DID` gets 1 for actions that had an effect. Returns how the visit ended, the next state, the number of states, the
    number of outcomes, the same before equal outcomes were merged, and the action.
    """
    space = len(S)
    T, G, L, S, F, RI, RF = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(RI), matrix(RF)
    BITS, C = matrix(BITS), matrix(C)
    K = places(L)
    while head < count <= LIMIT:
        if made >= WANTED:
            return PAUSED, head, count, used, made, 0
        first, before = used, made
        for action in range(ACTIONS):
            STARTS[head * ACTIONS + action] = used
            if S[head, 0] != 0:
                continue
            begin_script(D)
            number, last = 0, used
            while True:
                if count + 1 >= space or used >= len(TO):
                    return SPACE, head, count, first, before, action
                for column in range(width(S)):
                    S[count, column] = S[head, column]
                for column in range(width(F)):
                    F[count, column] = F[head, column]
                begin_outcome(D)
                reward, end, did = step_one(T[m], G[m], L, K, S[count], F[count], RI, RF, D, 0, action)
                DID[head * ACTIONS + action] |= did
                number += 1
                if number > MOST or is_script_full(D):
                    return MANY, head, count, first, before, action
                if S[count, 0] != 0:
                    return WRONG, head, count, first, before, action
                chance = D[CHANCE]
                found = add_state(T, G, L, K, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, count, end != 0)
                if found < 0:
                    return WRONG, head, count, first, before, action
                count += found == count
                if used > last and TO[used - 1] == found and REWARD[used - 1] == reward and END[used - 1] == end:
                    P[used - 1] += chance
                else:
                    TO[used], P[used], REWARD[used], END[used] = found, chance, reward, end
                    used += 1
                if not next_script(D):
                    break
            made += number
        head += 1
        STARTS[head * ACTIONS] = used
    return DONE, head, count, used, made, 0


def expand(
    T, G, L, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, head, last, count, made, TRIED, MOST, WANTED, SOUGHT,
    BEFORE, BY,
):  # fmt: skip
    """Do the actions `TRIED` in the states `head` to `last - 1`. Unknown next states get the next numbers.

    Stops early if an episode ends as `SOUGHT`, space is lacking, `WANTED` outcomes are made, or an action fails.

    Returns how it ended, the next state, the number of states, the number of outcomes made, and the action.
    """
    space = len(S)
    T, G, L, S, F, RI, RF = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(RI), matrix(RF)
    BITS, C = matrix(BITS), matrix(C)
    K = places(L)
    while head < last:
        if made >= WANTED:
            return PAUSED, head, count, made, 0
        before = made
        for place in range(len(TRIED)):
            action = TRIED[place]
            begin_script(D)
            number = 0
            while True:
                if count + 1 >= space:
                    return SPACE, head, count, before, action
                for column in range(width(S)):
                    S[count, column] = S[head, column]
                for column in range(width(F)):
                    F[count, column] = F[head, column]
                begin_outcome(D)
                _, end, _ = step_one(T[m], G[m], L, K, S[count], F[count], RI, RF, D, 0, action)
                number += 1
                if number > MOST or is_script_full(D):
                    return MANY, head, count, before, action
                if S[count, 0] != 0:
                    return WRONG, head, count, before, action
                if end == SOUGHT:
                    return FOUND, head, count, before, action
                if end == 0:
                    found = add_state(T, G, L, K, S, F, RI, RF, D, m, BITS, HASHED, C, OBS, count, 0)
                    if found < 0:
                        return WRONG, head, count, before, action
                    if found == count:
                        BEFORE[count], BY[count] = head, action
                        count += 1
                if not next_script(D):
                    break
            made += number
        head += 1
    return DONE, head, count, made, 0


def forget_last(S, BITS, HASHED, first, count):
    """Remove the states from `first` to `count - 1`, which were added last, from the hash table."""
    S, BITS = matrix(S), matrix(BITS)
    for row in range(count - 1, first - 1, -1):
        forget(S, BITS, HASHED, row)
