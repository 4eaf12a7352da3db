"""Proximal policy optimisation of a small network on tables, compiled by numba or run by Python.

The text is compiled behind that of `kernels`, which samples random numbers. Sums are computed in the order of the text,
so both ways give the same numbers bit for bit. Names of arrays:

    FIRST, STARTS, START_CHANCE, START_FIRST: states and start states of levels; see `LevelTables`.
    TO, CHANCE, REWARD, ENDED: outcome `k` of action `a` in state `s` is at `(s * actions + a) * width + k`.
    SEEN_FIRST, SEEN: the inputs that are 1 in a state; all others are 0.
    P: parameters: weights [inputs, hidden], biases [hidden], weights [hidden, outputs], biases [outputs]. The outputs
        are a logit for each action and the value.
    ROW, VISITED, COUNT: the row of each state whose outputs are cached, or -1; the state of each row; their number.
    HIDDEN, OUT: for each row, the outputs of the hidden units; the probability of each action and the value.
"""

# ruff: noqa: F821
# mypy: ignore-errors

from math import exp, inf, log, sqrt

GOES_ON, TERMINATED, TRUNCATED = 0, 1, 2


def look(P, SEEN_FIRST, SEEN, state, row, HIDDEN, OUT, inputs, hidden, outputs):
    """Compute the network's outputs in a state, and write them into a row of `HIDDEN` and `OUT`."""
    first = row * hidden
    at = inputs * hidden
    for unit in range(hidden):
        HIDDEN[first + unit] = P[at + unit]
    for place in range(SEEN_FIRST[state], SEEN_FIRST[state + 1]):
        weights = SEEN[place] * hidden
        for unit in range(hidden):
            HIDDEN[first + unit] += P[weights + unit]
    second = at + hidden
    out = row * outputs
    for output in range(outputs):
        OUT[out + output] = P[second + hidden * outputs + output]
    for unit in range(hidden):
        active = HIDDEN[first + unit]
        if active > 0.0:
            for output in range(outputs):
                OUT[out + output] += active * P[second + unit * outputs + output]
        else:
            HIDDEN[first + unit] = 0.0
    greatest = OUT[out]
    for action in range(1, outputs - 1):
        greatest = max(greatest, OUT[out + action])
    total = 0.0
    for action in range(outputs - 1):
        OUT[out + action] = exp(OUT[out + action] - greatest)
        total += OUT[out + action]
    for action in range(outputs - 1):
        OUT[out + action] /= total


def output_row(P, SEEN_FIRST, SEEN, state, ROW, VISITED, COUNT, HIDDEN, OUT, shape):
    """Return the row of a state's outputs in `HIDDEN` and `OUT`; if they are not cached, compute them in a new row."""
    row = ROW[state]
    if row < 0:
        row = COUNT[0]
        COUNT[0] = row + 1
        ROW[state] = row
        VISITED[row] = state
        look(P, SEEN_FIRST, SEEN, state, row, HIDDEN, OUT, shape[0], shape[1], shape[2])
    return row


def forget(levels, student):
    """Clear the cached outputs of all states; necessary after the parameters have changed."""
    ROW, VISITED, COUNT = vector(student[1]), vector(student[2]), vector(student[3])
    for row in range(COUNT[0]):
        ROW[VISITED[row]] = -1
    COUNT[0] = 0


def sample_place(CHANCE, first, count, draw):
    """Return an index among `count` from `first` on, sampled by the probabilities `CHANCE`; `draw` is uniform."""
    total = 0.0
    for place in range(first, first + count - 1):
        total += CHANCE[place]
        if draw < total:
            return place
    return first + count - 1


def collect(levels, student, chosen, streams, most, episodes, limit, tracks):
    """Play levels by the policy: each for `most` steps or `episodes` episodes, whichever is less.

    Args:
        levels, student: the arrays of `LevelTables`, and of a `PolicyLearner`.
        chosen: int64, the levels.
        streams: uint64 [1, 4], the random stream; advanced.
        most, episodes: steps and episodes of a level.
        limit: steps after which an episode is truncated.
        tracks: for step `t` of the level at index `b`, at `b * most + t`: the rows of its state and of the next one,
            the action, the reward, and `GOES_ON`, `TERMINATED` or `TRUNCATED`; and the steps of each level. Written.
    """
    START_FIRST, STARTS, START_CHANCE = vector(levels[1]), vector(levels[2]), vector(levels[3])
    TO, CHANCE, REWARD, ENDED = vector(levels[4]), vector(levels[5]), vector(levels[6]), vector(levels[7])
    SEEN_FIRST, SEEN = vector(levels[8]), vector(levels[9])
    P, ROW, VISITED, COUNT = vector(student[0]), vector(student[1]), vector(student[2]), vector(student[3])
    HIDDEN, OUT, shape = vector(student[4]), vector(student[5]), student[6]
    AT, AFTER, ACTION = vector(tracks[0]), vector(tracks[1]), vector(tracks[2])
    GAIN, HOW, STEPS = vector(tracks[3]), vector(tracks[4]), vector(tracks[5])
    R = matrix(streams)
    outputs, width = shape[2], shape[3]
    actions = outputs - 1
    for b in range(len(chosen)):
        level = chosen[b]
        begins, starts = START_FIRST[level], START_FIRST[level + 1] - START_FIRST[level]
        step, finished, age, state = 0, 0, 0, -1
        while step < most and finished < episodes:
            if age == 0:
                place = begins
                if starts > 1:
                    place = sample_place(START_CHANCE, begins, starts, uniform(R, 0))
                state = STARTS[place]
            row = output_row(P, SEEN_FIRST, SEEN, state, ROW, VISITED, COUNT, HIDDEN, OUT, shape)
            out = row * outputs
            action = sample_place(OUT, out, actions, uniform(R, 0)) - out
            at = (state * actions + action) * width
            if width > 1:
                at = sample_place(CHANCE, at, width, uniform(R, 0))
            state = TO[at]
            age += 1
            place = b * most + step
            AT[place], ACTION[place], GAIN[place] = row, action, REWARD[at]
            if ENDED[at] > 0:
                AFTER[place], HOW[place] = -ENDED[at], TERMINATED
            else:
                AFTER[place] = output_row(P, SEEN_FIRST, SEEN, state, ROW, VISITED, COUNT, HIDDEN, OUT, shape)
                HOW[place] = TRUNCATED if age == limit or ENDED[at] < 0 else GOES_ON
            if HOW[place] != GOES_ON:
                finished += 1
                age = 0
            step += 1
        STEPS[b] = step


def advantages(student, tracks, most, discount, smoothing, ADVANTAGES):
    """Write generalised advantage estimates (Schulman et al. 2016, eq. 16) of all played steps into `ADVANTAGES`."""
    OUT, outputs = vector(student[5]), student[6][2]
    AT, AFTER, GAIN = vector(tracks[0]), vector(tracks[1]), vector(tracks[3])
    HOW, STEPS = vector(tracks[4]), vector(tracks[5])
    A = vector(ADVANTAGES)
    value = outputs - 1
    for b in range(len(tracks[5])):
        following = 0.0
        for step in range(STEPS[b] - 1, -1, -1):
            place = b * most + step
            target = GAIN[place]
            if HOW[place] != TERMINATED:
                target += discount * OUT[AFTER[place] * outputs + value]
            if HOW[place] != GOES_ON:
                following = 0.0
            following = target - OUT[AT[place] * outputs + value] + discount * smoothing * following
            A[place] = following


def measure(student, tracks, most, discount, smoothing, ADVANTAGES, BEST, SCORES):
    """Write the scores of levels that the literature defines (see `Played`), computed from the steps that were played.

    Args:
        BEST: the greatest return seen on each level before; updated.
        SCORES: float64 [levels, 7]: mean positive and mean absolute advantage, mean of the best return minus the
            value, the negative advantage, finished episodes, successes among them, sum of their returns. Written.
    """
    OUT, outputs = vector(student[5]), student[6][2]
    AT, AFTER, GAIN = vector(tracks[0]), vector(tracks[1]), vector(tracks[3])
    HOW, STEPS = vector(tracks[4]), vector(tracks[5])
    A, V, S = vector(ADVANTAGES), outputs - 1, matrix(SCORES)
    best = vector(BEST)
    for b in range(len(tracks[5])):
        positive, absolute, values, lost = 0.0, 0.0, 0.0, 0.0
        episodes, successes, total, factor, begun, gained = 0, 0, 0.0, 1.0, b * most, 0.0
        for step in range(STEPS[b]):
            place = b * most + step
            positive += max(0.0, A[place])
            absolute += abs(A[place])
            values += OUT[AT[place] * outputs + V]
            total += factor * GAIN[place]
            factor *= discount
            if HOW[place] != GOES_ON or step == STEPS[b] - 1:
                if HOW[place] != GOES_ON:
                    episodes += 1
                    successes += HOW[place] == TERMINATED and AFTER[place] == -1
                    best[b] = max(best[b], total)
                    gained += total
                lost += negative_advantage(OUT, AT, AFTER, GAIN, HOW, begun, place, outputs, discount, smoothing)
                total, factor, begun = 0.0, 1.0, place + 1
        S[b, 0], S[b, 1] = positive / STEPS[b], absolute / STEPS[b]
        S[b, 2] = best[b] - values / STEPS[b]
        S[b, 3] = lost / STEPS[b] if successes > 0 else 0.0
        S[b, 4], S[b, 5], S[b, 6] = episodes, successes, gained


def negative_advantage(OUT, AT, AFTER, GAIN, HOW, first, last, outputs, discount, smoothing):
    """Return minus the sum over an episode's steps of the average of n-step advantages at their running minimum."""
    found = 0.0
    for begin in range(first, last + 1):
        here = OUT[AT[begin] * outputs + outputs - 1]
        total, factor, least, weight, average = 0.0, 1.0, inf, 1.0, 0.0
        for place in range(begin, last + 1):
            total += factor * GAIN[place]
            factor *= discount
            advantage = total - here
            if HOW[place] != TERMINATED:
                advantage += factor * OUT[AFTER[place] * outputs + outputs - 1]
            least = min(least, advantage)
            share = weight if place == last else weight * (1.0 - smoothing)
            average += share * least
            weight -= share
        found -= average
    return found


def improve(levels, student, optimiser, tracks, most, ADVANTAGES, order, first, rates):
    """Do one step of Adam on a minibatch: the levels `order[first[0]:first[1]]` of those that were played.

    The loss is that of Schulman et al. 2017, eq. 9: the clipped objective with advantages standardised over the
    minibatch, plus half the squared error of the value, minus the entropy. The gradients of all occurrences of a
    state are summed, and then propagated through the network once.
    """
    SEEN_FIRST, SEEN = vector(levels[8]), vector(levels[9])
    P, VISITED, OUT, shape = vector(student[0]), vector(student[2]), vector(student[5]), student[6]
    G, NEW_HIDDEN, NEW = vector(optimiser[2]), vector(optimiser[3]), vector(optimiser[4])
    SLOT, USED, C = vector(optimiser[5]), vector(optimiser[6]), vector(optimiser[7])
    AT, ACTION, STEPS = vector(tracks[0]), vector(tracks[2]), vector(tracks[5])
    A, ORDER = vector(ADVANTAGES), vector(order)
    inputs, hidden, outputs = shape[0], shape[1], shape[2]
    actions, value = outputs - 1, outputs - 1
    clip, entropy, worth = rates[2], rates[3], rates[4]
    count, total, squares = 0, 0.0, 0.0
    for one in range(first[0], first[1]):
        b = ORDER[one]
        for place in range(b * most, b * most + STEPS[b]):
            count += 1
            total += A[place]
            squares += A[place] * A[place]
    mean = total / count
    spread = sqrt(max(0.0, squares / count - mean * mean)) + 1e-8
    used = 0
    for one in range(first[0], first[1]):
        b = ORDER[one]
        for place in range(b * most, b * most + STEPS[b]):
            row = AT[place]
            slot = SLOT[row]
            if slot < 0:
                slot = used
                SLOT[row] = slot
                USED[slot] = row
                used += 1
                look(P, SEEN_FIRST, SEEN, VISITED[row], slot, NEW_HIDDEN, NEW, inputs, hidden, outputs)
                for output in range(outputs + 1):
                    C[slot * (outputs + 1) + output] = 0.0
            action = ACTION[place]
            advantage = (A[place] - mean) / spread
            ratio = NEW[slot * outputs + action] / OUT[row * outputs + action]
            sums = slot * (outputs + 1)
            if (advantage >= 0.0 and ratio <= 1.0 + clip) or (advantage < 0.0 and ratio >= 1.0 - clip):
                C[sums + action] += advantage * ratio
            target = A[place] + OUT[row * outputs + value]
            C[sums + value] += NEW[slot * outputs + value] - target
            C[sums + outputs] += 1.0
    second = inputs * hidden + hidden
    for place in range(second + hidden * outputs + outputs):
        G[place] = 0.0
    for slot in range(used):
        sums, out = slot * (outputs + 1), slot * outputs
        times, all_actions, uncertain = C[sums + outputs], 0.0, 0.0
        for action in range(actions):
            all_actions += C[sums + action]
            chance = NEW[out + action]
            if chance > 0.0:
                uncertain -= chance * log(chance)
        for action in range(actions):
            chance = NEW[out + action]
            slope = chance * all_actions - C[sums + action]
            if chance > 0.0:
                slope += entropy * times * chance * (log(chance) + uncertain)
            NEW[out + action] = slope / count
        NEW[out + value] = worth * C[sums + value] / count
        add_gradient(P, G, SEEN_FIRST, SEEN, VISITED[USED[slot]], slot, NEW_HIDDEN, NEW, inputs, hidden, outputs)
        SLOT[USED[slot]] = -1
    adam_step(P, G, optimiser, rates, second + hidden * outputs + outputs)


def add_gradient(P, G, SEEN_FIRST, SEEN, state, slot, HIDDEN, SLOPES, inputs, hidden, outputs):
    """Add the gradient of a state to the total gradient. The state's row of `HIDDEN` is overwritten."""
    first, out = slot * hidden, slot * outputs
    at = inputs * hidden
    second = at + hidden
    for output in range(outputs):
        G[second + hidden * outputs + output] += SLOPES[out + output]
    for unit in range(hidden):
        active, slope = HIDDEN[first + unit], 0.0
        if active > 0.0:
            weights = second + unit * outputs
            for output in range(outputs):
                slope += P[weights + output] * SLOPES[out + output]
                G[weights + output] += active * SLOPES[out + output]
        HIDDEN[first + unit] = slope
    for unit in range(hidden):
        G[at + unit] += HIDDEN[first + unit]
    for place in range(SEEN_FIRST[state], SEEN_FIRST[state + 1]):
        weights = SEEN[place] * hidden
        for unit in range(hidden):
            G[weights + unit] += HIDDEN[first + unit]


def adam_step(P, G, optimiser, rates, size):
    """Change the parameters `P` by a step of Adam (Kingma and Ba 2015, algorithm 1), limiting the gradient's norm."""
    MEAN, SQUARE, TIME = vector(optimiser[0]), vector(optimiser[1]), vector(optimiser[8])
    norm = 0.0
    for place in range(size):
        norm += G[place] * G[place]
    norm = sqrt(norm)
    scale = min(1.0, rates[1] / (norm + 1e-12))
    TIME[0] *= 0.9
    TIME[1] *= 0.999
    rate, bias = rates[0] / (1.0 - TIME[0]), 1.0 / (1.0 - TIME[1])
    for place in range(size):
        slope = G[place] * scale
        mean = 0.9 * MEAN[place] + 0.1 * slope
        square = 0.999 * SQUARE[place] + 0.001 * slope * slope
        MEAN[place], SQUARE[place] = mean, square
        P[place] -= rate * mean / (sqrt(square * bias) + 1e-5)


def expect(levels, student, chosen, limit, discount, greedy, PRESENT, NEXT, FOUND):
    """Compute the exact probability of success and discounted return of the policy on levels, within `limit` steps.

    Args:
        chosen: int64, the levels.
        greedy: True to take the likeliest action, the lowest of equals, instead of sampling.
        PRESENT, NEXT: space for as many states as a level has; 0 before and after.
        FOUND: float64 [levels, 2], written.
    """
    FIRST, START_FIRST = vector(levels[0]), vector(levels[1])
    STARTS, START_CHANCE = vector(levels[2]), vector(levels[3])
    TO, CHANCE, REWARD, ENDED = vector(levels[4]), vector(levels[5]), vector(levels[6]), vector(levels[7])
    SEEN_FIRST, SEEN = vector(levels[8]), vector(levels[9])
    P, ROW, VISITED, COUNT = vector(student[0]), vector(student[1]), vector(student[2]), vector(student[3])
    HIDDEN, OUT, shape = vector(student[4]), vector(student[5]), student[6]
    outputs, width = shape[2], shape[3]
    actions = outputs - 1
    present, after, F = vector(PRESENT), vector(NEXT), matrix(FOUND)
    for b in range(len(chosen)):
        level = chosen[b]
        offset, states = FIRST[level], FIRST[level + 1] - FIRST[level]
        for place in range(START_FIRST[level], START_FIRST[level + 1]):
            present[STARTS[place] - offset] += START_CHANCE[place]
        success, total, factor = 0.0, 0.0, 1.0
        for _ in range(limit):
            running = 0.0
            for local in range(states):
                share = present[local]
                if share > 0.0:
                    present[local] = 0.0
                    running += share
                    state = offset + local
                    out = outputs * output_row(P, SEEN_FIRST, SEEN, state, ROW, VISITED, COUNT, HIDDEN, OUT, shape)
                    likeliest = 0
                    if greedy:
                        for action in range(1, actions):
                            if OUT[out + action] > OUT[out + likeliest]:
                                likeliest = action
                    for action in range(actions):
                        taken = share * OUT[out + action]
                        if greedy:
                            taken = share if action == likeliest else 0.0
                        if taken > 0.0:
                            first = (state * actions + action) * width
                            for place in range(first, first + width):
                                chance = taken * CHANCE[place]
                                total += factor * chance * REWARD[place]
                                if ENDED[place] == 1:
                                    success += chance
                                elif ENDED[place] == 0:
                                    after[TO[place] - offset] += chance
            if running == 0.0:
                break
            factor *= discount
            present, after = after, present
        for local in range(states):
            present[local] = 0.0
        F[b, 0], F[b, 1] = success, total
