"""Functions that every program contains: sampling, sorting, bit sets, hashing, and the loop over environments.

The text of these functions precedes the program's own text. They only know arrays. They call functions of the program
(`begin`, `step_one`, `may_one`, `look`, `places`), and array access and bit operations of `_arrays` or
`_python_kernels`.
"""

# ruff: noqa: F821, SIM110
# mypy: ignore-errors

from math import inf, nan

import numpy as np

CAPACITY = 4096
"""Maximum number of rows of one query; more are the error `OVERFLOW`."""
BELOW = 1.0 - 2.0**-53
STEPS = 1
"""Index of `D`: the number of steps that the current run of a unit may still take; before it is the random number."""
NAN, INFINITY = nan, inf
FAILED, REFUSED, OVERFLOW, FULL = 1, 2, 3, 5
"""Error codes of an environment: a missing value or another error that ends a run, a refused rule, too many rows, or
too many created objects."""
BEGIN, SKIP = -1, -2
"""Entries of `A` that are not actions: begin an episode, and leave the environment as it is."""
NO_INT, INT_LIMIT = -(2**63), 2.0**63
"""Represents a missing int; and the smallest float that is larger than all ints."""
WHOLE = 2**32 - 1
U64 = np.uint64


def pick(D, count):
    """Sample one of `count` alternatives uniformly from the random number `D[0]`; store its unused rest in `D[0]`."""
    scaled = D[0] * count
    place = min(int(scaled), count - 1)
    D[0] = min(scaled - place, BELOW)
    return place


def choose(D, chances, lacking):
    """Sample an alternative with given probabilities from `D[0]`; return -1 with the rest (1 minus their sum).

    The part of the random number that the choice does not use is stored in `D[0]`.
    """
    rest = D[0]
    start = 0.0
    for number in range(len(chances)):
        chance = chances[number]
        if rest < start + chance:
            D[0] = min(max((rest - start) / chance, 0.0), BELOW)
            return number
        start += chance
    missing = 1.0 - start
    if missing > 1e-12:
        D[0] = min(max((rest - start) / missing, 0.0), BELOW)
        return -1
    D[0] = 0.0
    return len(chances) - 1


def uniform(R, e):
    """Return the next double of NumPy's PCG64 in [0, 1), and update the generator state in row `e` of `R`."""
    lo, hi = R[e, 0], R[e, 1]
    m_lo, m_hi = U64(4865540595714422341), U64(2549297995355413924)
    mask, half = U64(0xFFFFFFFF), U64(32)
    a0, a1, b0, b1 = lo & mask, lo >> half, m_lo & mask, m_lo >> half
    p00, p01, p10, p11 = a0 * b0, a0 * b1, a1 * b0, a1 * b1
    middle = (p00 >> half) + (p01 & mask) + (p10 & mask)
    high = p11 + (p01 >> half) + (p10 >> half) + (middle >> half)
    new_lo = lo * m_lo
    new_hi = high + hi * m_lo + lo * m_hi
    lo = new_lo + R[e, 2]
    carry = U64(1) if lo < new_lo else U64(0)
    hi = new_hi + R[e, 3] + carry
    R[e, 0], R[e, 1] = lo, hi
    mixed, turns = hi ^ lo, hi >> U64(58)
    mixed = (mixed >> turns) | (mixed << ((U64(64) - turns) & U64(63)))
    return (mixed >> U64(11)) * (1.0 / 9007199254740992.0)


def nth_bit(word, number):
    """Return the position of a set bit of a word; `number` 0 is the lowest set bit."""
    for _ in range(number):
        word &= word - 1
    return lowest_bit(word)


def slide(A, start, step, used, RI, top, nothing):
    """Move the entries of created objects, which are `step` apart, to the front, and fill the rest with `nothing`.

    An entry is removed if `RI[top + number, 0]` is negative.
    """
    kept = 0
    for number in range(used):
        if RI[top + number, 0] >= 0:
            A[start + kept * step] = A[start + number * step]
            kept += 1
    for number in range(kept, used):
        A[start + number * step] = nothing


def slide_bits(S, words, place, used, RI, top):
    """Move the bits of created objects, which begin at `place`, as `slide` moves entries."""
    kept = place
    for number in range(place, place + used):
        word = S[words + (number >> 5)]
        S[words + (number >> 5)] = word & (WHOLE ^ bit_at(number))
        if RI[top + number - place, 0] >= 0:
            if bit(word, number):
                S[words + (kept >> 5)] |= bit_at(kept)
            kept += 1


def renumber(S, start, count, first, RI, top):
    """Replace object numbers from `first` on by their new numbers, which the rows from `top` on contain."""
    for number in range(start, start + count):
        if S[number] >= first:
            S[number] = first + RI[top + S[number] - first, 0]


def keep(S, F, ints, floats, RI, RF, top):
    """Copy a state, but for its error, to the rows of the row buffers from `top` on."""
    for number in range(1, ints):
        RI[top + number, 0] = S[number]
    for number in range(floats):
        RF[top + number, 0] = F[number]


def put_back(S, F, ints, floats, RI, RF, top):
    """Restore the state that `keep` copied to the row buffers. The error of the state stays as it is."""
    for number in range(1, ints):
        S[number] = RI[top + number, 0]
    for number in range(floats):
        F[number] = RF[top + number, 0]


def float_rank(value):
    """Return the rank of a number, rounded to float32, among all float32 numbers; that of 0.0 is 0."""
    bits = np.int64(np.float32(value).view(np.int32))
    return bits if bits >= 0 else -(2**31) - bits


def place_of(V, first, count, value):
    """Return the position of a value among `count` entries of a table from `first` on; -1 if it is not there."""
    for number in range(count):
        if V[first + number] == value:
            return number
    return -1


def drop_row(RI, RF, row, end):
    """Remove a row, and move the rows after it, up to `end`, one position to the front."""
    for number in range(row + 1, end):
        for column in range(width(RI)):
            RI[number - 1, column] = RI[number, column]
            RF[number - 1, column] = RF[number, column]


def add_exactly(RF, top, parts, value):
    """Add a value to an exact sum of floats, stored as partial sums in the rows from `top` on; return their number."""
    kept = 0
    for number in range(parts):
        other = RF[top + number, 0]
        if abs(value) < abs(other):
            value, other = other, value
        whole = value + other
        lost = other - (whole - value)
        if lost != 0.0:
            RF[top + kept, 0] = lost
            kept += 1
        value = whole
    RF[top + kept, 0] = value
    return kept + 1


def sum_exactly(RF, top, parts):
    """Return the float nearest to the exact sum stored by `add_exactly`, rounded as by `math.fsum`."""
    whole, lost = 0.0, 0.0
    while parts > 0 and lost == 0.0:
        parts -= 1
        other = RF[top + parts, 0]
        before = whole
        whole = before + other
        lost = other - (whole - before)
    if parts > 0 and (lost < 0.0) == (
        RF[top + parts - 1, 0] < 0.0
    ):  # half way between two floats: the remaining parts decide
        doubled = whole + 2.0 * lost
        if 2.0 * lost == doubled - whole:
            whole = doubled
    return whole


def wide(T, place):
    """Return an int of 64 bits, which two entries of the tables hold: first its lower 32 bits."""
    return (T[place + 1] << 32) | (T[place] & WHOLE)


def within(S, value, beyond):
    """Return True if an int has at most 64 bits (`beyond` is false) and does not represent a missing value.

    Otherwise set the error of the state: the live engine may go on where a program cannot.
    """
    if beyond or value == NO_INT:
        S[0] = FAILED
        return False
    return True


def whole(number):
    """Return a float without fraction as an int, and False; or 0 and True if the int has more than 64 bits."""
    if -INT_LIMIT <= number < INT_LIMIT:
        return int(number), False
    return 0, True


def nearest(number):
    """Return the nearest float without fraction; of two, the larger."""
    low = np.floor(number)
    return low + 1.0 if number - low >= 0.5 else low


def order(one, other):
    """Return a float that is less than, equal to or greater than 0 as an int is less, equal or greater than a float."""
    difference = float(one) - other
    if difference == 0.0:  # rounding may have made them equal
        return -1.0 if other >= INT_LIMIT else float(one - int(other))
    return difference


def quotient(left, right):
    """Return the quotient of two ints, truncated toward zero."""
    if right == -1:
        return left if left == NO_INT else -left  # processors cannot divide `NO_INT` by -1
    result = left // right
    if result < 0 and result * right != left:
        result += 1
    return result


def rest(left, right):
    """Return the remainder of two ints, with the sign of the left operand."""
    return left - quotient(left, right) * right


def fmod(left, right):
    """Return the remainder of two floats, with the sign of the left operand."""
    return np.fmod(left, right)


def modulo(left, right):
    """Return the remainder of two ints, with the sign of the right operand."""
    result = rest(left, right)
    return result + right if result != 0 and (result < 0) != (right < 0) else result


def less(RI, RF, one, other, width, floats):
    """Return True if row `one` precedes row `other` in lexicographic order; bit i of `floats` marks a float column."""
    for column in range(width):
        if (floats >> column) & 1:
            if RF[one, column] != RF[other, column]:
                return RF[one, column] < RF[other, column]
        elif RI[one, column] != RI[other, column]:
            return RI[one, column] < RI[other, column]
    return False


def sort_rows(RI, RF, top, count, width, floats, repeated):
    """Sort rows lexicographically, remove duplicates if `repeated` is true, and return the number of rows."""
    for number in range(top + 1, top + count):
        place = number
        while place > top and less(RI, RF, place, place - 1, width, floats):
            for column in range(width):
                RI[place, column], RI[place - 1, column] = RI[place - 1, column], RI[place, column]
                RF[place, column], RF[place - 1, column] = RF[place - 1, column], RF[place, column]
            place -= 1
    if not repeated or count == 0:
        return count
    last = top
    for number in range(top + 1, top + count):
        if less(RI, RF, last, number, width, floats):
            last += 1
            for column in range(width):
                RI[last, column] = RI[number, column]
                RF[last, column] = RF[number, column]
    return last - top + 1


def hash_row(S, BITS, row):
    """Return a hash of the state in a row."""
    value = np.uint64(14695981039346656037)
    for column in range(width(S)):
        value = (value ^ np.uint64(S[row, column])) * np.uint64(1099511628211)
        value ^= value >> np.uint64(29)
    for column in range(width(BITS)):
        value = (value ^ np.uint64(BITS[row, column])) * np.uint64(1099511628211)
        value ^= value >> np.uint64(29)
    return value


def same_row(S, BITS, one, other):
    """Return True if the states in two rows are equal."""
    for column in range(width(S)):
        if S[one, column] != S[other, column]:
            return False
    for column in range(width(BITS)):
        if BITS[one, column] != BITS[other, column]:
            return False
    return True


def hash_place(S, BITS, HASHED, row):
    """Return the first slot of the hash table to look up for the state in a row."""
    return np.int64(hash_row(S, BITS, row) & np.uint64(len(HASHED) - 1))


def number_of(S, BITS, HASHED, row):
    """Return the row of a known state equal to the state in `row`; if none exists, add `row` to the hash table."""
    place = hash_place(S, BITS, HASHED, row)
    while HASHED[place] >= 0:
        if same_row(S, BITS, HASHED[place], row):
            return HASHED[place]
        place = (place + 1) & (len(HASHED) - 1)
    HASHED[place] = row
    return row


def hash_all(S, BITS, HASHED, first, count):
    """Add the states of the rows from `first` to `count - 1` to the hash table, which contains none of them."""
    S, BITS = matrix(S), matrix(BITS)
    for row in range(first, count):
        number_of(S, BITS, HASHED, row)


def forget(S, BITS, HASHED, row):
    """Remove the state in `row` from the hash table. It must be the state that was added last."""
    place = hash_place(S, BITS, HASHED, row)
    while HASHED[place] != row:
        place = (place + 1) & (len(HASHED) - 1)
    HASHED[place] = -1


def reset_one(T, G, L, K, S, F, RI, RF, D, e, m, S0, F0):
    """Reset an environment to a start state, sampled with the random number in `D`."""
    for column in range(width(S)):
        S[e, column] = S0[m, column]
    for column in range(width(F)):
        F[e, column] = F0[m, column]
    begin(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0)


def advance(W):
    """Step each environment with its action in `A`: `BEGIN` begins an episode, and `SKIP` changes nothing.

    `Q` holds the number of environments, 1 if `U` contains random numbers or 0 if they are sampled from the streams `R`
    into `U`, and the limit of steps, or 0. `J` holds the first column of each component in the one-hot rows `HOT`.
    Returns the last environment with an error, or -1; the second row of `B` and `BF` is its state before the step.
    """
    T, G, L, S, F, RI, RF, D, M, S0, F0, R, C, STEPS, OVER, OBS, REWARD, END, CUT, U, A, HOT, B, BF, J, Q = arrays_at(W)
    failed = -1
    K = places(L)
    hot = width(C) if width(HOT) > 0 else 0
    count, given, limit = Q[0], Q[1], Q[2]
    for e in range(count):
        m = M[e]
        if A[e] == SKIP:
            continue
        if given == 0:
            U[e] = uniform(R, e)
        D[0] = U[e]
        if A[e] == BEGIN:
            reset_one(T, G, L, K, S, F, RI, RF, D, e, m, S0, F0)
            STEPS[e] = 0
            OVER[e] = False
            REWARD[e] = 0.0
            END[e] = 0
            CUT[e] = False
        else:
            for column in range(width(S)):
                B[0, column] = S[e, column]
            for column in range(width(F)):
                BF[0, column] = F[e, column]
            REWARD[e], end, _ = step_one(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0, A[e])
            END[e] = end
            STEPS[e] += 1
            cut = end < 0 or (limit > 0 and STEPS[e] >= limit)
            CUT[e] = cut
            OVER[e] = end > 0 or cut
        if S[e, 0] == 0:
            for column in range(hot):
                HOT[e, J[column] + C[e, column]] = 0.0
            OBS[e] = look(T[m], G[m], L, K, S[e], F[e], RI, RF, D, 0, C[e])
            for column in range(hot):
                HOT[e, J[column] + C[e, column]] = 1.0
        if S[e, 0] != 0:
            failed = e
            for column in range(width(S)):
                B[1, column] = B[0, column]
            for column in range(width(F)):
                BF[1, column] = BF[0, column]
    return failed
