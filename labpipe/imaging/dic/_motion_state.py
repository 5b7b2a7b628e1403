"""State of the tracked points between frames, and prediction of their next position.

The rule is one line of numpy each; but it runs three times for every frame, and a dozen calls on
arrays of fifty points take as long as filtering the image. So it is compiled.
"""

import math

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.compilation import compiled, inner

#: The constant-velocity prediction is not stretched over more than this times the last step.
STRETCH = 3.0
#: Neighbours that must vote to contradict a point, how close to each other (px), how far from it (px).
FEWEST, UNITED, APART = 4, 1.0, 1.0


@compiled()
def predicted(motion: Floats, velocity: Floats, seen: Integers, step: Floats, is_tracked: Flags, index: int) -> Floats:
    """Continue motions with constant velocity to a frame.

    ``motion``: (point, 6), when each point was seen last, see :class:`.Solution`; ``velocity``: (point, 2) [px
    per frame]; ``seen``: integer (point,), frame of ``motion``, -1 for never; ``step``: (point,), frames between
    the last two sightings; ``is_tracked``: bool (point,), lost points stay where they were; ``index``: the frame.

    Returns array (point, 6).
    """
    result = motion.copy()
    for n in range(len(seen)):
        gap = index - seen[n]
        if seen[n] >= 0 and is_tracked[n] and gap <= STRETCH * step[n]:
            result[n, 0] += velocity[n, 0] * gap
            result[n, 3] += velocity[n, 1] * gap
    return result


@compiled()
def extent(places: Floats, half: Integers, motion: Floats, chosen: Flags) -> Floats:
    """Bound the moved subsets of chosen points.

    ``places``: (point, 2) [px], centres in the reference; ``half``: integer (point,) [px], half widths;
    ``motion``: (point, 6), where they go; ``chosen``: bool (point,), which count.

    Returns array (4,) [px], left, right, top, bottom; infinite the wrong way round when none is chosen.
    """
    result = np.array([np.inf, -np.inf, np.inf, -np.inf])
    for n in range(len(half)):
        if not chosen[n]:
            continue
        x, y = places[n, 0] + motion[n, 0], places[n, 1] + motion[n, 3]
        # a turned square is wider than a straight one
        reach_x = half[n] * (1.0 + abs(motion[n, 1]) + abs(motion[n, 2]))
        reach_y = half[n] * (1.0 + abs(motion[n, 4]) + abs(motion[n, 5]))
        result[0] = min(result[0], x - reach_x)
        result[1] = max(result[1], x + reach_x)
        result[2] = min(result[2], y - reach_y)
        result[3] = max(result[3], y + reach_y)
    return result


@compiled()
def converged_nearby(
    motion: Floats, expected: Floats, has_converged: Flags, zncc: Floats, least_zncc: Floats, farthest: Floats
) -> Flags:
    """Tell points that need no confirmation: close to where they were expected, and alike.

    ``motion``, ``expected``: (point, 6), found and predicted; ``has_converged``: bool (point,), as the solver
    says; ``zncc``, ``least_zncc``: (point,) [1], correlation found and needed; ``farthest``: (point,) [px], from
    the prediction.

    Returns bool array (point,).
    """
    result = np.zeros(len(zncc), np.bool_)
    for n in range(len(zncc)):
        dx, dy = motion[n, 0] - expected[n, 0], motion[n, 3] - expected[n, 3]
        is_near = dx * dx + dy * dy <= farthest[n] * farthest[n]
        result[n] = has_converged[n] and is_near and zncc[n] > least_zncc[n]
    return result


@inner()
def _sort(values: Floats, count: int, order: Floats) -> None:
    """Put the first values in order; numpy's own sort and median compile three seconds longer."""
    for k in range(count):
        place = k
        while place > 0 and order[place - 1] > values[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = values[k]


@inner()
def _median(values: Floats, count: int, order: Floats) -> float:
    _sort(values, count, order)
    return 0.5 * float(order[(count - 1) // 2] + order[count // 2])


@compiled()
def contradicted(places: Floats, neighbours: Integers, motion: Floats, is_trusted: Flags) -> Flags:
    """Tell trusted points whose neighbours agree with each other and not with them.

    ``places``: (point, 2) [px], centres in the reference; ``neighbours``: integer (point, neighbour), who is
    asked about each point; ``motion``: (point, 6), found, see :class:`.Solution`; ``is_trusted``: bool (point,),
    points that count as found; others have no vote.

    Returns bool array (point,).

    Notes
    -----
    At least :data:`FEWEST` must vote and all but one of them must lie within :data:`UNITED` of their
    median, carried to the point with the turn and stretch that each of them found; a point is
    contradicted when it lies farther than :data:`APART` from that median, and farther than four times
    the farthest of them. So neither the border of two bodies nor a pattern that stretches
    contradicts anybody.
    """
    result = np.zeros(len(places), np.bool_)
    count = neighbours.shape[1]
    x, y, apart, order = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for n in range(len(places)):
        if not is_trusted[n]:
            continue
        votes = 0
        farthest_x = farthest_y = 0.0
        for k in range(count):
            m = neighbours[n, k]
            if is_trusted[m]:
                j, i = places[n, 0] - places[m, 0], places[n, 1] - places[m, 1]
                x[votes] = motion[m, 0] + motion[m, 1] * j + motion[m, 2] * i
                y[votes] = motion[m, 3] + motion[m, 4] * j + motion[m, 5] * i
                farthest_x = max(farthest_x, abs(x[votes] - motion[n, 0]))
                farthest_y = max(farthest_y, abs(y[votes] - motion[n, 3]))
                votes += 1
        # the median lies no farther than the farthest of them
        if votes < FEWEST or math.hypot(farthest_x, farthest_y) <= APART:
            continue
        u, v = _median(x, votes, order), _median(y, votes, order)
        for k in range(votes):
            apart[k] = math.hypot(x[k] - u, y[k] - v)
        _sort(apart, votes, order)
        spread = order[votes - 2]
        own = math.hypot(motion[n, 0] - u, motion[n, 3] - v)
        result[n] = spread < UNITED and own > APART and own > 4.0 * spread
    return result


@compiled()
def remember(
    found: Floats,
    zncc: Floats,
    is_trusted: Flags,
    index: int,
    motion: Floats,
    velocity: Floats,
    seen: Integers,
    step: Floats,
    last_zncc: Floats,
    is_tracked: Flags,
    misses: Integers,
) -> None:
    """Update the state with what was found in a frame; the arrays after ``index`` are changed.

    ``found``: (point, 6), motions in this frame; ``zncc``: (point,) [1], their correlation; ``is_trusted``: bool
    (point,), points that count as found; ``index``: the frame; ``motion``, ``velocity``, ``seen``, ``step``,
    ``is_tracked``: see :func:`predicted`; ``last_zncc``: (point,) [1], correlation when each point was seen last;
    ``misses``: integer (point,), frames in a row in which it was not found.
    """
    for n in range(len(seen)):
        gap = index - seen[n]
        has_velocity = is_trusted[n] and is_tracked[n] and seen[n] >= 0 and gap > 0
        velocity[n, 0] = (found[n, 0] - motion[n, 0]) / gap if has_velocity else 0.0
        velocity[n, 1] = (found[n, 3] - motion[n, 3]) / gap if has_velocity else 0.0
        step[n] = gap if has_velocity else 1.0
        is_tracked[n] = is_trusted[n]
        misses[n] = 0 if is_trusted[n] else misses[n] + 1
        if is_trusted[n]:
            for k in range(found.shape[1]):  # whole rows would compile two seconds longer
                motion[n, k] = found[n, k]
            seen[n] = index
            last_zncc[n] = zncc[n]
