"""Choices that a script decides, one combination after the other.

Part of the text of programs that try all choices, behind `kernels`, whose `pick` and `choose` are replaced.
"""

# mypy: ignore-errors

MADE, CHANCE, KNOWN, ROOM, LACKS, MOST, SCRIPT = 0, 2, 3, 4, 5, 6, 7
"""Indices of `D`, with `STEPS` between them: choices made, their probability, choices in the script, the length of `D`,
1 if it was too short, and how many combinations a test tries; then alternative and count of each choice."""


def next_choice(D, count):
    """Return the alternative of the next choice: from the script, or else 0, which is then added to the script.

    If the script is full, return 0, add nothing, and record that it lacks space.
    """
    if is_script_full(D):
        D[LACKS] = 1.0
        return 0
    number = int(D[MADE])
    there = SCRIPT + 2 * number
    place = int(D[there]) if number < D[KNOWN] else 0
    D[there], D[there + 1] = place, count
    D[MADE] = number + 1
    return place


def pick(D, count):
    """Return one of `count` equally likely alternatives, as the script decides, and update the probability."""
    D[CHANCE] /= count
    return next_choice(D, count)


def choose(D, chances, missing):
    """Return an alternative with a positive probability, or -1 with probability `missing`, as the script decides."""
    possible = 0
    for number in range(len(chances)):
        if chances[number] > 0.0:
            possible += 1
    place = next_choice(D, possible + (missing > 1e-12))
    for number in range(len(chances)):
        if chances[number] > 0.0:
            if place == 0:
                D[CHANCE] *= chances[number]
                return number
            place -= 1
    D[CHANCE] *= missing
    return -1


def begin_script(D):
    """Begin with the first combination of choices, by clearing the script."""
    D[KNOWN] = 0


def begin_outcome(D):
    """Begin an outcome: set the number of choices made to 0, and their probability to 1. The script stays."""
    D[MADE], D[CHANCE] = 0, 1.0


def next_script(D):
    """Change the script to the next combination of choices. Return False if the last outcome used the last one."""
    number = int(D[MADE])
    while number > 0 and D[SCRIPT + 2 * number - 2] + 1 == D[SCRIPT + 2 * number - 1]:
        number -= 1
    if number == 0:
        return False
    D[SCRIPT + 2 * number - 2] += 1
    D[KNOWN] = number
    return True


def first_count(D):
    """Return the number of alternatives of the first choice, or -1 if it is unknown."""
    return int(D[SCRIPT + 1]) if D[KNOWN] > 0 else -1


def is_script_full(D):
    """Return True if the script has no space for another choice, so that choices may be missing from it."""
    return SCRIPT + 2 * int(D[MADE]) + 1 >= D[ROOM]
