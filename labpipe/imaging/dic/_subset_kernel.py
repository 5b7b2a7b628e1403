"""The compiled loops of the subset solver, which takes Gauss–Newton steps; importing this module imports numba."""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.dic._subset_sums import sum_subset

#: Result codes of the solver; the last is given to subsets of which too little is seen to be solved.
SOLVED, LEFT_WINDOW, NOT_CONVERGED, NO_TEXTURE, HIDDEN = 0, 1, 2, 3, 4
#: What may be solved for beyond the motion that a subset is allowed: light that slopes across it,
#: a change of blur, stretch of a subset that may be rigid or affine, and light that curves across it.
LIGHT, BLUR, AFFINE, CURVE = 1, 2, 4, 8
#: Columns of the least squares: the six motions; j, i, f j, f i of the light; three of the blur. Those of light
#: that curves, F j², F i j and F i² of all of the grey level F, squares less their mean, come after them where
#: they are asked for.
MOTIONS, COLUMNS, CURVED = 6, 13, 16
#: Fall of the residual, in units of its variance, from which a group is solved for: exceeded by
#: noise in less than one result of a thousand.
_LIGHT_NEEDED, _BLUR_NEEDED, _AFFINE_NEEDED, _CURVE_NEEDED = 20.0, 12.0, 18.0, 18.0
#: A step that ends farther than this from the start (px) has left the basin of convergence.
CAPTURE = 12.0

# A first step has no history: a step of e px leaves an error below e²/2 (measured: 0.2 e²).
_FIRST_SHRINK = 0.5
# Longest stretch of a step: noise then holds three quarters of the squared slopes.
_MOST_RELAXATION = 4.0


@compiled(nogil=True)
def compose_with_inverse(p: Floats, step: Floats, is_rigid: bool) -> None:
    """Replace the motion ``p`` by ``p`` after the inverse of ``step``."""
    if is_rigid:
        # The inverse of (R, t) is (Rᵀ, -Rᵀ t); a rotation stays one exactly.
        a, b = math.cos(step[4]), math.sin(step[4])
        c, d = -b, a
        determinant = 1.0
        a11, a12, a21, a22 = a, c, b, d
    else:
        a11, a12, a21, a22 = 1.0 + step[1], step[2], step[4], 1.0 + step[5]
        determinant = a11 * a22 - a12 * a21
    i11, i12 = a22 / determinant, -a12 / determinant
    i21, i22 = -a21 / determinant, a11 / determinant
    tx = -(i11 * step[0] + i12 * step[3])
    ty = -(i21 * step[0] + i22 * step[3])
    m11, m12, m21, m22 = 1.0 + p[1], p[2], p[4], 1.0 + p[5]
    p[0] += m11 * tx + m12 * ty
    p[3] += m21 * tx + m22 * ty
    p[1] = m11 * i11 + m12 * i21 - 1.0
    p[2] = m11 * i12 + m12 * i22
    p[4] = m21 * i11 + m22 * i21
    p[5] = m21 * i12 + m22 * i22 - 1.0


@part()
def is_inside(x: float, y: float, half: float, p: Floats, window: tuple[float, float, float, float]) -> bool:
    """Whether the four corners of the moved subset lie in the window."""
    for sj in (-1.0, 1.0):
        for si in (-1.0, 1.0):
            j = sj * half
            i = si * half
            cx = x + j + p[0] + p[1] * j + p[2] * i
            cy = y + i + p[3] + p[4] * j + p[5] * i
            # Written so that NaN is outside.
            if not (window[0] <= cx <= window[1] and window[2] <= cy <= window[3]):
                return False
    return True


@part()
def own_contrast(step: Floats, moments: Floats, energy: float, solved: int) -> float:
    """Share of the contrast that is the pattern's: what light has in common with the pattern is no contrast of it."""
    own = 1.0
    for a in range(MOTIONS, solved):
        if a < MOTIONS + 4 or a >= COLUMNS:
            own -= step[a] * moments[1, a] / energy
    return own


@compiled(nogil=True)
def _gauss_newton_step(
    sums: Floats,
    pixels: float,
    energy: float,
    moments: Floats,
    normal: Floats,
    inverse: Floats,
    solved: int,
    slopes: Floats,
    step: Floats,
    quality: Floats,
) -> bool:
    """Step, gain, residual and correlation from the sums; False when nothing is alike."""
    average = sums[0] / pixels
    contrast = sums[1] - average * sums[0]
    # Written so that NaN fails.
    if not ((sums[2] > 0.0 or (solved > MOTIONS and sums[2] < 0.0)) and contrast > 0.0):
        return False
    gain = energy / sums[2]
    for b in range(len(slopes)):
        slopes[b] = gain * (sums[3 + b] - average * moments[0, b]) - moments[1, b]
    for a in range(solved):
        step[a] = 0.0
        for b in range(solved):
            step[a] += inverse[a, b] * slopes[b]
    # The last step is not evaluated again: by how much it lowers the residual is known.
    fall = 0.0
    for a in range(solved):
        for b in range(solved):
            fall += step[a] * normal[a, b] * step[b]
    residual = max(gain * gain * contrast - energy - fall, 0.0)
    if solved > MOTIONS:
        own = own_contrast(step, moments, energy, solved)
        if not gain * own > 0.0:
            return False
        gain /= own
        residual /= own * own
        for a in range(solved):
            slopes[a] /= own
            step[a] /= own
    quality[0] = gain
    quality[1] = residual
    quality[2] = math.sqrt(energy / (energy + residual))
    return True


@compiled(nogil=True)
def _needed(
    model: int,
    slopes: Floats,
    step: Floats,
    solved: int,
    p: Floats,
    normal: Floats,
    inverse: Floats,
    tester: Floats,
    surplus: float,
    variance: float,
) -> int:
    """Tell which groups of columns lower the residual by more than noise does, solved for or not.

    Noise of the reference is missing in the frame, which therefore looks softer: ``surplus`` is what
    this adds to the sum of bend and residual.
    """
    for a in range(len(slopes)):
        for b in range(solved):
            slopes[a] -= normal[a, b] * step[b]
    weights = np.zeros(13)
    for k in range(4):
        weights[k] = step[6 + k] if model & LIGHT else slopes[6 + k]
    if model & BLUR:
        for k in range(3):
            weights[4 + k] = step[10 + k] - inverse[10 + k, 10] * surplus
    else:
        weights[4] = slopes[10] - surplus
    if model & AFFINE:
        weights[7] = 0.5 * ((1.0 + p[1]) ** 2 + p[4] ** 2 - 1.0)
        weights[8] = 0.5 * ((1.0 + p[5]) ** 2 + p[2] ** 2 - 1.0)
        weights[9] = 0.5 * ((1.0 + p[1]) * p[2] + (1.0 + p[5]) * p[4])
    else:
        weights[7], weights[8], weights[9] = slopes[1], slopes[5], slopes[2] + slopes[4]
    for k in range(len(slopes) - COLUMNS):
        weights[10 + k] = step[COLUMNS + k] if model & CURVE else slopes[COLUMNS + k]
    result = 0
    for first, last, limit, group in (
        (0, 4, _LIGHT_NEEDED, LIGHT),
        (4, 7, _BLUR_NEEDED, BLUR),
        (7, 10, _AFFINE_NEEDED, AFFINE),
        (10, 10 + len(slopes) - COLUMNS, _CURVE_NEEDED, CURVE),
    ):
        fall = 0.0
        for a in range(first, last):
            for b in range(first, last):
                fall += weights[a] * tester[a, b] * weights[b]
        if fall > limit * variance:
            result |= group
    return result


@part()
def _iterate(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    window: tuple[float, float, float, float],
    layout: Integers,
    is_rigid: bool,
    packed: Floats32,
    level: Floats,
    moments: Floats,
    normal: Floats,
    inverse: Floats,
    tester: Floats,
    model: int,
    is_tested: bool,
    noise: tuple[float, float, float, float],
    most: float,
    tolerance: float,
    max_iterations: int,
    p: Floats,
    quality: Floats,
    work: tuple[Floats, Floats, Floats, Floats, Floats32],
) -> tuple[int, int, int]:
    """Iterate one subset; evaluations, result code and groups of columns that are needed."""
    sums, slopes, step, before, values = work
    half = layout[2]
    pixels = level[2]
    start_x, start_y = p[0], p[3]
    last2 = 0.0
    relaxation = 1.0
    solved = len(normal) if model & (LIGHT | BLUR | CURVE) else MOTIONS
    with_all = is_tested or solved > MOTIONS
    with_curve = len(normal) > COLUMNS
    quality[3:] = 0.0
    if is_rigid:
        # a start that a neighbour gave may be stretched
        turn = math.atan2(p[4] - p[2], 2.0 + p[1] + p[5])
        p[1] = p[5] = math.cos(turn) - 1.0
        p[4] = math.sin(turn)
        p[2] = -p[4]
    for a in range(6):
        before[a] = 0.0
    for a in range(len(step)):
        step[a] = 0.0
    if inverse[0, 0] <= 0.0:
        return 0, NO_TEXTURE, 0
    for iteration in range(max_iterations):
        if not is_inside(layout[0], layout[1], half, p, window):
            return iteration, LEFT_WINDOW, 0
        sum_subset(coefficients, order, corner, layout, packed, level[0], p, with_all, with_curve, values, sums)
        if not _gauss_newton_step(sums, pixels, level[1], moments, normal, inverse, solved, slopes, step, quality):
            return iteration + 1, NOT_CONVERGED, 0
        size2 = 0.0
        along = 0.0
        for a in range(6):
            weight = half * half / 3.0 if a % 3 else 1.0
            size2 += weight * step[a] * step[a]
            along += weight * step[a] * before[a]
        shrink = math.sqrt(size2) * _FIRST_SHRINK
        if last2 > 0.0:
            # Noise in the slopes makes the steps too short by a constant factor, which shows in
            # two steps along the same line.
            relaxation /= 1.0 - min(along / last2, 0.75)
            relaxation = min(max(relaxation, 1.0), _MOST_RELAXATION)
            shrink = math.sqrt(size2 / last2)
        last2 = size2
        # Steps shrink by about a constant factor, so the next one can be foreseen.
        is_last = math.sqrt(size2) * min(shrink, 1.0) < tolerance
        needed = 0
        if is_last and with_all:
            variance = max(quality[1] / max(pixels - 8.0, 1.0), noise[3]) * noise[0]
            surplus = min(quality[1], most * quality[0] ** 2) * (noise[1] + noise[2] * moments[1, 10] / level[1])
            needed = _needed(model, slopes, step, solved, p, normal, inverse, tester, surplus, variance)
            quality[3], quality[4] = step[8], step[9]
            for k in range(3):
                quality[5 + k] = step[10 + k] - inverse[10 + k, 10] * surplus
        for a in range(6):
            before[a] = step[a]
            step[a] *= relaxation
        compose_with_inverse(p, step, is_rigid)
        # Written so that NaN is beyond.
        if not math.hypot(p[0] - start_x, p[3] - start_y) < CAPTURE:
            return iteration + 1, NOT_CONVERGED, 0
        if is_last:
            return iteration + 1, SOLVED, needed
    return max_iterations, NOT_CONVERGED, 0


@compiled(nogil=True)
def solve_subsets(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    window: tuple[float, float, float, float],
    chosen: Integers,
    layout: Integers,
    is_rigid: NDArray[np.bool_],
    packed: Floats32,
    level: Floats,
    moments: Floats,
    normal: Floats,
    inverse: Floats,
    tester: Floats,
    model: int,
    is_tested: NDArray[np.bool_],
    noise: tuple[float, float, float, float],
    most: Floats,
    tolerance: float,
    max_iterations: int,
    motion: Floats,
    quality: Floats,
    counts: Integers,
    scratch: Floats,
    values: Floats32,
) -> None:
    """Iterate every chosen subset to convergence; ``motion`` holds the start and the result."""
    # Work arrays come from outside and results are set one by one: that spares half the compiling.
    columns = normal.shape[1]
    work = (scratch[0], scratch[1, :columns], scratch[2, :columns], scratch[3, :6], values)
    for q in range(len(chosen)):
        n = chosen[q]
        evaluations, code, needed = _iterate(
            coefficients,
            order,
            corner,
            window,
            layout[n],
            is_rigid[n],
            packed,
            level[n],
            moments[n],
            normal[n],
            inverse[n],
            tester[n],
            model,
            is_tested[q],
            noise,
            most[q],
            tolerance,
            max_iterations,
            motion[q],
            quality[q],
            work,
        )
        counts[q, 0] = evaluations
        counts[q, 1] = code
        counts[q, 2] = needed
