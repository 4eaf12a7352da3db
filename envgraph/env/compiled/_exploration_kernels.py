"""Code that is added to a program of rules to explore all states: it applies each rule at each of its matches."""

# ruff: noqa: F821
# mypy: ignore-errors

DONE, SPACE, WRONG, PAUSED, FOUND, MANY, DEEP = 0, 1, 2, 3, 4, 5, 6
"""Results of an exploration: all is done, arrays are full, an error of a rule, as many transitions as were wanted are
made, the goal is found, there are more states than the limit, or the next state has the maximal depth."""


def explore(
    T, G, L, S, F, RI, RF, D, BITS, HASHED, C, MOVES, REALS, head, count, used, refused, RULES, LIMIT, DEPTH, GOAL,
    WANTED,
):  # fmt: skip
    """Make all moves in each state, in the order of the states' numbers. New states get the next numbers.

    At first `count` is 0, and row 0 contains the first state. The columns of `C` are the depth of a state and its
    tests; `GOAL` is 0, or the column of the goal. The columns of `MOVES` are source, target, rule, and the match, whose
    floats are in `REALS`.

    Returns how the exploration ended, the next state, and the numbers of states, transitions and refused moves; before
    the next state was expanded if the exploration goes on.
    """
    space, room = len(S), len(MOVES)
    T, G, L, S, F, RI, RF = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(RI), matrix(RF)
    BITS, C, MOVES, REALS = matrix(BITS), matrix(C), matrix(MOVES), matrix(REALS)
    K = places(L)
    if count == 0:
        count += 1 + number_of(S, BITS, HASHED, 0)
        look(T[0], G[0], L, K, S[0], F[0], RI, RF, D, CAPACITY, C[0])
        if S[0, 0] != 0 or C[0, GOAL] != 0:
            return WRONG if S[0, 0] != 0 else FOUND, head, count, used, refused
    while head < count:
        if C[head, 0] == DEPTH or used >= WANTED:
            return DEEP if C[head, 0] == DEPTH else PAUSED, head, count, used, refused
        first, before = used, refused
        for rule in range(RULES):
            matches = may_one(T[0], G[0], L, K, S[head], F[head], RI, RF, D, 0, rule)
            if S[head, 0] != 0:
                return WRONG, head, count, first, before
            for row in range(matches):
                if count + 1 >= space or used >= room:
                    return SPACE, head, count, first, before
                for column in range(width(S)):
                    S[count, column] = S[head, column]
                for column in range(width(F)):
                    F[count, column] = F[head, column]
                step_one(T[0], G[0], L, K, S[count], F[count], RI, RF, D, CAPACITY, CAPACITY * rule + row)
                if S[count, 0] == REFUSED:
                    refused += 1
                    continue
                if S[count, 0] != 0:
                    return WRONG, head, count, first, before
                found = number_of(S, BITS, HASHED, count)
                is_new = found == count
                if is_new:
                    if count >= LIMIT:
                        return MANY, head, count, used, refused
                    C[count, 0] = 0
                    look(T[0], G[0], L, K, S[count], F[count], RI, RF, D, CAPACITY, C[count])
                    if S[count, 0] != 0:
                        return WRONG, head, count, first, before
                    is_new = C[count, GOAL] != 0
                    C[count, 0] = C[head, 0] + 1
                    count += 1
                MOVES[used, 0], MOVES[used, 1], MOVES[used, 2] = head, found, rule
                for column in range(width(MOVES) - 3):
                    MOVES[used, 3 + column] = RI[row, column]
                for column in range(width(REALS)):
                    REALS[used, column] = RF[row, column]
                used += 1
                if is_new:
                    return FOUND, head, count, used, refused
        head += 1
    return DONE, head, count, used, refused
