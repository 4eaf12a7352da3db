"""Functions, added to a program's text, that play episodes of a policy; they follow the text that defines `decide`.

`decide` returns the action that `POLICY` chooses in the current state, or -1 after an error, and True if the action was
sampled at random.
"""

# ruff: noqa: F821
# mypy: ignore-errors


def follow(T, G, L, S, F, BITS, RI, RF, D, m, S0, F0, R, C, POLICY, EPISODES, LIMIT):
    """Play episodes of a policy; return True if no error occurred, the successes, the total reward, and all steps.

    If the first episode draws no random number, all episodes are equal; its results are multiplied instead.
    """
    T, G, L, S, F, BITS = fixed(T), fixed(G), vector(L), matrix(S), matrix(F), matrix(BITS)
    RI, RF, D, R, C, S0, F0 = matrix(RI), matrix(RF), vector(D), matrix(R), matrix(C), fixed(S0), fixed(F0)
    K = places(L)
    successes, total, steps = 0, 0.0, 0
    for _ in range(EPISODES):
        draw = uniform(R, 0)
        D[0] = draw
        reset_one(T, G, L, K, S, F, RI, RF, D, 0, m, S0, F0)
        drawn = D[0] != draw
        for _ in range(LIMIT):
            action, by_lot = decide(T, G, L, K, S, F, BITS, RI, RF, D, m, R, C, POLICY)
            if action < 0:
                return False, successes, total, steps
            draw = uniform(R, 0)
            D[0] = draw
            reward, ended, _ = step_one(T[m], G[m], L, K, S[0], F[0], RI, RF, D, 0, action)
            drawn = drawn or by_lot or D[0] != draw
            if S[0, 0] != 0:
                return False, successes, total, steps
            total += reward
            steps += 1
            if ended != 0:
                successes += ended == 1
                break
        if not drawn:
            return True, successes * EPISODES, total * EPISODES, steps * EPISODES
    return True, successes, total, steps
