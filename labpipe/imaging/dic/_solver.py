"""Matching of subsets in a frame: inverse-compositional Gauss–Newton iteration.

The criterion is the zero-normalised sum of squared differences, in its least-squares form: the
motion is found together with a gain and an offset of the grey levels. Gradients come from the
reference only, so noise of the deformed image does not bias the result, and the matrix of the
normal equations is inverted once per subset. Importing this module imports numba.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._kernels import LEFT_WINDOW, NO_TEXTURE, NOT_CONVERGED, SOLVED, solve_subsets
from labpipe.imaging.dic._spline import PADDING
from labpipe.imaging.dic._subsets import Subsets

__all__ = ["LEFT_WINDOW", "NOT_CONVERGED", "NO_TEXTURE", "OVERHANG", "SOLVED", "Solution", "solve"]

#: Error that may be left by stopping (px): a tenth of the least noise of a large subset.
TOLERANCE = 5e-5
#: Chi-square of three degrees of freedom that noise exceeds in one of twenty subsets.
STRAIN_SEEN = float(chdtri(3, 0.05))
#: Two or three evaluations are usual; more than this means that the start was wrong.
_MOST_ITERATIONS = 30
#: A subset may hang over the border of the frame by less than this (px): the noise of a point
#: that rests at the border. The spline is mirrored there.
OVERHANG = 0.5


@dataclass(frozen=True)
class Solution:
    """Result of the solver for each subset, in the order asked for.

    Attributes
    ----------
    motion : array (point, 6)
        ``(u, u_x, u_y, v, v_x, v_y)``, px and px per px.
    quality : array (point, 4)
        Factor from the frame's grey levels to those of the reference; sum of squared differences in grey levels
        of the reference, gain and offset fitted; zero-normalised cross-correlation; share of the blocks of the
        subset that show nothing of its pattern.
    covariance : array (point, 4)
        Of dx dx, dy dy, dx dy, and of the rotation: of :func:`solve` from the residual alone, of the tracker
        with the noise, see :func:`.covariance`.
    iterations : integer array (point,)
        Evaluations of the subset in the frame.
    code : integer array (point,)
        ``SOLVED``, ``LEFT_WINDOW``, ``NOT_CONVERGED`` or ``NO_TEXTURE``.
    is_affine : bool array (point,)
        The subset was solved with stretch and shear.
    hidden : array (point,)
        Share of the subset behind a stated obstruction.
    """

    motion: Floats
    quality: Floats
    covariance: Floats
    iterations: Integers
    code: Integers
    is_affine: Flags
    hidden: Floats

    @property
    def zncc(self) -> Floats:
        """Zero-normalised cross-correlation (point,)."""
        return self.quality[:, 2]


def solve(
    subsets: Subsets,
    coefficients: Floats32,
    order: int,
    chosen: Integers,
    motion: Floats,
    *,
    origin: tuple[int, int],
    window: tuple[float, float, float, float],
    inflation: Floats | None = None,
    strain_seen: float = STRAIN_SEEN,
    capture: float = 12.0,
) -> Solution:
    """Find the motions of chosen subsets in one frame.

    Parameters
    ----------
    subsets : Subsets
        The reference.
    coefficients : array from :func:`.prefilter`
        Spline coefficients of the frame or of a rectangle of it.
    order : 3 or 5
        Spline order of the coefficients.
    chosen : integer array (point,)
        Subsets to be matched.
    motion : array (point, 6) [px]
        Start, usually the prediction from the frames before.
    origin : (x, y) [px]
        Frame position of the first pixel of the rectangle.
    window : (left, right, top, bottom) [px]
        Frame coordinates that a subset's corners must not leave; at most :data:`OVERHANG`
        outside the rectangle.
    inflation : array (point,), optional
        Variance of what noise adds to the normal equations over that of uncorrelated noise of the same residual:
        blur and interpolation correlate it.
    strain_seen : float
        Chi-square of the three components of strain from which an ``AUTO`` subset is solved as an affine one.
    capture : float [px]
        A step that ends farther from the start has left the basin of convergence.

    References
    ----------
    Z. Jiang et al., Opt. Lasers Eng. 65 (2015) 93-102,
    https://doi.org/10.1016/j.optlaseng.2014.06.011
    """
    count = len(chosen)
    found = np.array(motion, np.float64, order="C").reshape(count, 6)
    quality, spread = np.full((2, count, 4), np.nan)
    counts = np.zeros((count, 3), np.int64)
    if count:
        corner = (float(origin[0] - PADDING), float(origin[1] - PADDING))
        solve_subsets(
            (coefficients, order, corner, window),
            subsets.arrays,
            np.ascontiguousarray(chosen, np.int64),
            np.ones(len(subsets)) if inflation is None else inflation,
            strain_seen,
            TOLERANCE,
            capture,
            _MOST_ITERATIONS,
            found,
            quality,
            spread,
            counts,
        )
    return Solution(found, quality, spread, counts[:, 0], counts[:, 1], counts[:, 2] > 0, np.zeros(count))
