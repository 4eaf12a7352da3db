"""Loops over the arrays of tables, compiled by numba like the programs of `envgraph.env.compiled`, or run by Python.

Arrays of a table are flat: outcome `k` of action `a` in state `s` is at `(s * actions + a) * width + k`. Sums are
computed in this order, so both ways give the same numbers bit for bit.
"""

# mypy: ignore-errors


def search(FOLLOWING, CHANCE, ENDED, STARTS, START_CHANCE, actions, width, outcome, STEPS, QUEUE):
    """Return the fewest steps after which an episode can end with `outcome`, or 0 if it cannot.

    `STEPS`, 0 before, receives for each visited state the number of the step that leaves it. `QUEUE` is space.
    """
    count, head = 0, 0
    for place in range(len(STARTS)):
        if START_CHANCE[place] > 0.0:
            STEPS[STARTS[place]] = 1
            QUEUE[count] = STARTS[place]
            count += 1
    while head < count:
        state = QUEUE[head]
        head += 1
        for place in range(state * actions * width, (state + 1) * actions * width):
            if CHANCE[place] > 0.0:
                if ENDED[place] == outcome:
                    return STEPS[state]
                following = FOLLOWING[place]
                if ENDED[place] == 0 and STEPS[following] == 0:
                    STEPS[following] = STEPS[state] + 1
                    QUEUE[count] = following
                    count += 1
    return 0


def settle(FOLLOWING, CHANCE, REWARD, ENDED, actions, width, discount, enough, most, VALUES, NEW):
    """Do at most `most` sweeps of value iteration, until no value changes by more than `enough`.

    Return the greatest change in the last sweep. `VALUES` holds the first and then the last values; `NEW` is space.
    """
    new, old = NEW, VALUES
    sweeps, change = 0, enough + 1.0
    while sweeps < most and change > enough:
        change = 0.0
        place = 0
        for state in range(len(VALUES)):
            best = 0.0
            for action in range(actions):
                value = 0.0
                for _ in range(width):
                    chance = CHANCE[place]
                    if chance > 0.0:
                        gain = REWARD[place]
                        if ENDED[place] == 0:
                            gain += discount * old[FOLLOWING[place]]
                        value += chance * gain
                    place += 1
                if action == 0 or value > best:
                    best = value
            change = max(change, abs(best - old[state]))
            new[state] = best
        old, new = new, old
        sweeps += 1
    for state in range(len(VALUES)):
        VALUES[state] = old[state]
    return change


def chain(FOLLOWING, CHANCE, REWARD, ENDED, POLICY, actions, width, FIRST, TO, MOVED, SUCCESS, GAIN):
    """Write the Markov chain of a policy, and return the number of its transitions.

    The transitions of a state, with targets `TO` and probabilities `MOVED`, begin at its entry of `FIRST`. The
    probability of success and the expected reward of a step in the state are added to `SUCCESS` and `GAIN`.
    """
    used, place = 0, 0
    for state in range(len(SUCCESS)):
        FIRST[state] = used
        for action in range(actions):
            share = POLICY[state * actions + action]
            for _ in range(width):
                chance = share * CHANCE[place]
                if chance > 0.0:
                    GAIN[state] += chance * REWARD[place]
                    if ENDED[place] == 1:
                        SUCCESS[state] += chance
                    elif ENDED[place] == 0:
                        TO[used] = FOLLOWING[place]
                        MOVED[used] = chance
                        used += 1
                place += 1
    FIRST[len(SUCCESS)] = used
    return used


def follow(FIRST, TO, MOVED, SUCCESS, GAIN, discount, limit, PRESENT, NEXT):
    """Return the success probability, the expected discounted return and the expected steps of an episode.

    `PRESENT` is the distribution of its first state; it and `NEXT` are overwritten.
    """
    present, after = PRESENT, NEXT
    success, total, length, factor = 0.0, 0.0, 0.0, 1.0
    for _ in range(limit):
        running = 0.0
        for state in range(len(SUCCESS)):
            share = present[state]
            if share > 0.0:
                present[state] = 0.0
                running += share
                success += share * SUCCESS[state]
                total += factor * share * GAIN[state]
                for place in range(FIRST[state], FIRST[state + 1]):
                    after[TO[place]] += share * MOVED[place]
        if running == 0.0:
            break
        length += running
        factor *= discount
        present, after = after, present
    return success, total, length
