"""Code that is added to a program to visit all its states, with all choices.

Part of the program's text, behind `kernels` and `_scripted_choices`. Functions that are called from
outside get arrays, and convert them to vectors and matrices.
"""

# ruff: noqa: F821
# mypy: ignore-errors

DONE, SPACE, WRONG, MANY, FOUND, PAUSED, LIMITED = 0, 1, 2, 3, 4, 5, 6
"""Results of a visit: all is done, arrays are full, an error of the environment, too many outcomes of an action, the
wanted end or state is found, as many outcomes as were wanted are made, and there are more states than the limit."""

NO_MOVE = 3
"""The end of an outcome that does not exist: a rule that is explored has no match, or is refused."""


def visit(
    T, G, L, S, F, RI, RF, D, m, BITS, HASHED, S0, F0, C, OBS, BEFORE, BY, GAIN, STARTS, DID, TO, P, REWARD, END, MATCH,
    REALS, head, count, used, made, last, TRIED, SOUGHT, GOAL, MOST, LIMIT, WANTED,
):  # fmt: skip
    """Do the actions `TRIED` in each state before `last`, in the order of the states' numbers.

    If `head` is -1, first visit the states in which an episode may begin. New states get the next numbers; `BEFORE` and
    `BY` get the state and the number of the outcome that led there, and `GAIN` the sum of the rewards on the way. Stops
    at a new state with a component `GOAL` other than 0. If `SOUGHT` is not 0, outcomes and final states are not stored,
    `BY` gets actions, and the visit stops if an episode ends as `SOUGHT`.

    `DID` gets 1 for actions that had an effect. If rules are explored, the reward is the row of the match, which is
    stored. Returns how the visit ended, the place of the action, the next state, the number of states, the number of
    outcomes, and the same before equal outcomes were merged.
    """
    space, room = len(S), len(TO)
    T, G, L, S, F, RI, RF = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(RI), matrix(RF)
    S0, F0, BITS, C, STARTS, DID = fixed(S0), fixed(F0), matrix(BITS), matrix(C), matrix(STARTS), matrix(DID)
    MATCH, REALS = matrix(MATCH), matrix(REALS)
    K = places(L)
    while head < count and head < last:
        if made >= WANTED:
            return PAUSED, 0, head, count, used, made
        first, before = used, made
        for place in range(len(TRIED) if head >= 0 else 1):
            if head >= 0:
                STARTS[head, place] = used
                if S[head, 0] != 0:
                    continue
            begin_script(D)
            own, most = used, made + MOST
            while True:
                if count + 1 >= space or used >= room:
                    return SPACE, place, head, count, first, before
                begin_outcome(D)
                if head < 0:
                    reset_one(T, G, L, K, S, F, RI, RF, D, count, m, S0, F0)
                    reward, end = 0.0, 0
                else:
                    for column in range(width(S)):
                        S[count, column] = S[head, column]
                    for column in range(width(F)):
                        F[count, column] = F[head, column]
                    reward, end, did = step_one(T[m], G[m], L, K, S[count], F[count], RI, RF, D, 0, TRIED[place])
                    DID[head, place] |= did
                made += 1
                if (made > most and head >= 0) or is_script_full(D):
                    return MANY, place, head, count, first, before
                if S[count, 0] != 0:
                    return WRONG, place, head, count, first, before
                GAIN[count] = GAIN[head] + reward if head >= 0 else 0.0
                if SOUGHT != 0 and end == SOUGHT:
                    return FOUND, place, head, count, first, before
                if end == 0 or (SOUGHT == 0 and end != NO_MOVE):
                    chance = D[CHANCE]
                    S[count, 0] = end != 0
                    found = number_of(S, BITS, HASHED, count)
                    is_new = found == count
                    if is_new:
                        if count >= LIMIT:
                            return LIMITED, place, head, count, used, made - 1
                        S[count, 0] = 0
                        OBS[count] = look(T[m], G[m], L, K, S[count], F[count], RI, RF, D, 0, C[count])
                        if S[count, 0] != 0:
                            return WRONG, place, head, count, first, before
                        S[count, 0] = end != 0
                        BEFORE[count], BY[count] = head, used if SOUGHT == 0 else TRIED[place]
                        count += 1
                    if SOUGHT != 0:
                        pass
                    elif (
                        used > own and TO[used - 1] == found and REWARD[used - 1] == reward and END[used - 1] == end
                        and head >= 0
                    ):  # fmt: skip
                        P[used - 1] += chance
                    else:
                        TO[used], P[used], REWARD[used], END[used] = found, chance, reward, end
                        for column in range(width(MATCH)):
                            MATCH[used, column] = RI[int(reward), column]
                        for column in range(width(REALS)):
                            REALS[used, column] = RF[int(reward), column]
                        used += 1
                    if is_new and GOAL >= 0 and C[found, GOAL] != 0:
                        return FOUND, place, head, count, used, made
                if not next_script(D):
                    break
        head += 1
    return DONE, 0, head, count, used, made


def forget_last(S, BITS, HASHED, first, count):
    """Remove the states from `first` to `count - 1`, which were added last, from the hash table."""
    S, BITS = matrix(S), matrix(BITS)
    for row in range(count - 1, first - 1, -1):
        forget(S, BITS, HASHED, row)
