"""Match square subsets of a reference image in another one: inverse-compositional Gauss–Newton.

The criterion is the zero-normalised sum of squared differences, in its least-squares form: the
motion is found together with a gain and an offset of the grey levels. Gradients come from the
reference only, so noise of the deformed image does not bias the result, and the matrix of the
normal equations is inverted once per subset. Importing this module imports numba.

A motion is six numbers ``(u, u_x, u_y, v, v_x, v_y)``: the pixel at (j, i) from the subset's
centre moves to ``(j + u + u_x j + u_y i, i + v + v_x j + v_y i)``. A rigid motion is the same with
the matrix of a rotation.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._spline import LANES, PADDING
from labpipe.imaging.dic._subset_kernel import CURVED, LEFT_WINDOW, NO_TEXTURE, NOT_CONVERGED, SOLVED, solve_subsets
from labpipe.imaging.dic._subsets import Subsets

__all__ = ["LEFT_WINDOW", "NOT_CONVERGED", "NO_TEXTURE", "SOLVED", "NoiseShown", "Solution", "solve"]


#: Error that may be left by stopping (px): a tenth of the least noise of a large subset.
DEFAULT_TOLERANCE = 5e-5
#: Two or three evaluations are usual; more than this means that the start was wrong.
DEFAULT_ITERATIONS = 30
#: A subset may hang over the border of the frame by less than this (px): the noise of a point
#: that rests at the border. The spline is mirrored there.
OVERHANG = 0.5


#: Numbers that describe a change of light and blur.
CHANGES = 5


@dataclass(frozen=True)
class NoiseShown:
    """How the noise of an image shows in a residual.

    Attributes
    ----------
    colour : float [1]
        Variance that a smooth weight meets, over that of a pixel of the residual: blur and
        interpolation take the quick changes of the noise away.
    surplus : float [1/px²]
        Sum of the bend times the residual that noise of the reference alone makes, over the
        sum of its squares.
    share : float [1]
        Share of the residual that is noise of the reference: it raises the gain that is fitted.
    floor : float [grey²]
        Variance that a pixel of the residual has at least: that of rounding.
    """

    colour: float = 1.0
    surplus: float = 0.0
    share: float = 0.0
    floor: float = 0.0


@dataclass(frozen=True)
class Solution:
    """What the solver found for each subset, in the order asked for.

    Attributes
    ----------
    motion : array (point, 6)
        ``(u, u_x, u_y, v, v_x, v_y)``, px and px per px.
    zncc : array (point,) [1]
        Zero-normalised cross-correlation at the solution.
    gain : array (point,) [1]
        Factor from the frame's grey levels to those of the reference.
    residual : array (point,)
        Sum of squared differences in grey levels of the reference, gain and offset fitted.
    iterations : array (point,)
        Evaluations of the subset in the frame.
    code : array (point,)
        ``SOLVED``, ``LEFT_WINDOW``, ``NOT_CONVERGED`` or ``NO_TEXTURE``.
    needed : integer array (point,)
        Sum of ``LIGHT``, ``BLUR``, ``AFFINE`` and ``CURVE``: what lowers the residual by more than noise does,
        whether it was solved for or not; 0 where that was not tested, ``CURVE`` where light was not solved for.
    change : array (point, 5) [1/px, 1/px, px², px², px²]
        Slope of the light's gain to the right and downwards, and the weights of the bends; the
        first is half the growth of the blur's variance. 0 where they were not solved for.
    model : integer array (point,)
        What was solved for, as in :func:`solve`.
    """

    motion: Floats
    zncc: Floats
    gain: Floats
    residual: Floats
    iterations: Integers
    code: Integers
    needed: Integers
    change: Floats
    model: Integers


def solve(
    subsets: Subsets,
    coefficients: Floats32,
    order: int,
    chosen: Integers,
    motion: Floats,
    *,
    origin: tuple[int, int],
    window: tuple[float, float, float, float],
    model: int = 0,
    is_tested: Flags | None = None,
    noise: NoiseShown | None = None,
    most: Floats | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    max_iterations: int = DEFAULT_ITERATIONS,
) -> Solution:
    """Find the motions of chosen subsets in one frame.

    ``subsets``: the reference; ``coefficients``: spline coefficients of the frame or of a rectangle of it;
    ``order``: spline order of the coefficients; ``chosen``: integer (point,), which subsets to match; ``motion``:
    (point, 6) [px], start, usually the prediction from the frames before; ``origin``: (x, y) [px], frame position
    of the first pixel of the rectangle; ``window``: (left, right, top, bottom) [px], frame coordinates that a
    subset's corners must not leave; at most :data:`OVERHANG` outside the rectangle; ``model``: what to solve for
    beyond the allowed motion, the sum of ``LIGHT``, ``BLUR``, ``AFFINE`` and ``CURVE``; ``is_tested``: bool
    (point,), optional, of which subsets it shall be told what they need; of all by default; ``noise``: white
    noise that is neither blurred nor interpolated by default; ``most``: (point,), optional, residual [grey²] that
    noise leaves at most, in grey levels of the frame; unknown by default; ``tolerance``: float [px], iterate
    until the next step is expected to be smaller than this; ``max_iterations``: evaluations allowed per subset.

    Returns Solution, in the order of ``chosen``.

    References
    ----------
    Z. Jiang et al., Opt. Lasers Eng. 65 (2015) 93-102,
    https://doi.org/10.1016/j.optlaseng.2014.06.011
    """
    count = len(chosen)
    found = np.array(motion, np.float64, order="C").reshape(count, 6)
    quality = np.full((count, 8), np.nan)
    counts = np.zeros((count, 3), np.int64)
    noise = noise or NoiseShown()
    if count:
        matrices = subsets.model(model)
        moments, normal = subsets.products(model)
        corner = (float(origin[0] - PADDING), float(origin[1] - PADDING))
        solve_subsets(
            coefficients,
            order,
            corner,
            window,
            np.ascontiguousarray(chosen, np.int64),
            subsets.layout,
            subsets.rigid_in(model),
            subsets.packed,
            subsets.level,
            moments,
            normal,
            matrices.inverse,
            matrices.tester,
            model,
            np.ones(count, bool) if is_tested is None else is_tested,
            (noise.colour, noise.surplus, noise.share, noise.floor),
            np.full(count, np.inf) if most is None else most,
            tolerance,
            max_iterations,
            found,
            quality,
            counts,
            np.zeros((4, CURVED + 3)),
            np.zeros(2 * LANES + 2 * int(subsets.half.max()) + 1, np.float32),
        )
    iterations, code, needed = counts.T.copy()
    return Solution(
        found,
        quality[:, 2],
        quality[:, 0],
        quality[:, 1],
        iterations,
        code,
        needed,
        quality[:, 3:],
        np.full(count, model),
    )


def empty_solution(count: int) -> Solution:
    """Return answers that :func:`put` will fill."""
    whole = np.zeros((4, count), np.int64)
    zncc, gain, residual = np.full((3, count), np.nan)
    change = np.zeros((count, CHANGES))
    return Solution(np.zeros((count, 6)), zncc, gain, residual, whole[0], whole[1], whole[2], change, whole[3])


def put(target: Solution, where: Integers, source: Solution, chosen: Flags | slice) -> None:
    """Write the chosen answers of one solution over some of another, but for the iterations.

    ``where``: places in ``target``; ``chosen``: answers of ``source``, as many.
    """
    for field in ("motion", "zncc", "gain", "residual", "code", "needed", "change", "model"):
        getattr(target, field)[where] = getattr(source, field)[chosen]
