"""Thinning of long recordings for a page that preserves extremes and gaps.

Inside the windows that the reader is offered every sample is kept. Elsewhere the recording is
cut into buckets and from each the samples of its extremes are kept: the drawn points are true
samples, and no peak is lost.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# At least this share of the samples describes the whole range, however many windows there are.
_SHARE_FOR_THE_WHOLE = 0.25


def kept_samples(
    x: "NDArray[np.float64]",
    curves: "Sequence[NDArray[np.float64]]",
    limit: int,
    windows: Sequence[tuple[float, float]] = (),
) -> "NDArray[np.intp]":
    """Choose the samples that represent curves over a common axis.

    Parameters
    ----------
    x : ndarray (n,)
        Ascending; only used to find the windows.
    curves : sequence of ndarray (n,)
        The extremes of every curve are kept; NaN marks gaps, which are kept as gaps.
    limit : int
        How many samples may be kept. A few more are kept when gaps ask for it.
    windows : sequence of (from, to)
        All samples inside are kept, the narrowest window first, as long as three quarters of
        `limit` last.

    Returns
    -------
    ndarray of int (m,)
        Ascending indices; all of them when `n` is at most `limit`.

    Examples
    --------
    >>> import numpy as np
    >>> y = np.zeros(1000)
    >>> y[500] = 1.0
    >>> 500 in kept_samples(np.arange(1000.0), [y], 50)
    True
    """
    import numpy as np

    n = x.size
    if n <= limit:
        return np.arange(n)
    is_kept = np.zeros(n, dtype=bool)
    is_kept[[0, -1]] = True
    allowed = int(limit * (1 - _SHARE_FOR_THE_WHOLE))
    for start, stop in sorted(windows, key=lambda window: window[1] - window[0]):
        # One sample more on each side, so that the curve runs out of the window.
        first = max(int(np.searchsorted(x, start, "left")) - 1, 0)
        last = min(int(np.searchsorted(x, stop, "right")) + 1, n)
        if np.count_nonzero(is_kept) + np.count_nonzero(~is_kept[first:last]) <= allowed:
            is_kept[first:last] = True
    remaining = limit - int(np.count_nonzero(is_kept))
    n_buckets = max(remaining // (2 * len(curves)), 1)
    bucket = -(-n // n_buckets)
    for curve in curves:
        is_kept[_extremes(curve, bucket)] = True
    return np.flatnonzero(is_kept)


def _extremes(curve: "NDArray[np.float64]", bucket: int) -> "NDArray[np.intp]":
    """Return the indices of the smallest and largest value and of one gap in every bucket."""
    import numpy as np

    n_buckets = -(-curve.size // bucket)
    padded = np.full(n_buckets * bucket, np.nan)
    padded[: curve.size] = curve
    cells = padded.reshape(n_buckets, bucket)
    is_gap = np.isnan(cells)
    offset = np.arange(n_buckets) * bucket
    smallest = offset + np.where(is_gap, np.inf, cells).argmin(axis=1)
    largest = offset + np.where(is_gap, -np.inf, cells).argmax(axis=1)
    # The padding at the end is no gap.
    is_gap.ravel()[curve.size :] = False
    gaps = (offset + is_gap.argmax(axis=1))[is_gap.any(axis=1)]
    found = np.unique(np.concatenate([smallest, largest, gaps]))
    return found[found < curve.size]
