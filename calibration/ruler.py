"""The graduations of a ruler in an image.

Their distance in pixels, with a standard uncertainty, is for the ``pixel_length`` of a camera record.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals import deviation
from labpipe.units import Quantity

_FEWEST_LINES = 4  # a pitch with an honest uncertainty needs a few lines
_BANDS = 8  # pieces of the image in which the lines are located, for the tilt
_CLEAR = 4.0  # a line must stand out of the noise by so many standard deviations


class Ruler(NamedTuple):
    """A ruler found in an image.

    Attributes
    ----------
    pitch : Quantity [px]
        Distance of neighbouring graduations, measured at right angles to them.
    tilt : Quantity [rad]
        Of the ruler against the image axis.
    lines : array (line,) [px]
        Where the graduations cross the middle of the image.
    residual : float [px]
        Standard deviation of the lines about equal spacing.
    """

    pitch: Quantity
    tilt: Quantity
    lines: Floats
    residual: float


def graduations(image: NDArray[np.generic]) -> Ruler:
    """Measure the pitch of a ruler's graduations to a fraction of a pixel.

    Parameters
    ----------
    image : array (row, column)
        Holds the dark graduations of a ruler along the rows and little else; cut it to the ruler, and turn it, first.

    Raises
    ------
    InputError
        Fewer than four equally spaced lines rise out of the noise.

    Notes
    -----
    Lines are located by centroid in bands across the image; the tilt is the mean drift of all
    lines over the bands; the pitch is the slope of position against line number, times cos tilt.
    """
    from scipy.signal import find_peaks

    grey = np.asarray(image, float)
    if grey.ndim != 2:
        raise InputError(f"expected one image (row, column), found {grey.ndim} dimensions")
    grey = -grey
    # equally strong maxima of the mean profile, and their centroids
    profile = grey.mean(axis=0)
    smooth = ndimage.gaussian_filter1d(profile, 1.0)
    flat = smooth - ndimage.percentile_filter(smooth, 50, size=max(31, profile.size // 8))
    noise, strongest = deviation(np.diff(profile)) / np.sqrt(2), float(np.percentile(flat, 99.5))
    peaks, _ = find_peaks(flat, height=max(0.4 * strongest, _CLEAR * noise), distance=4)
    if len(peaks) < _FEWEST_LINES:
        raise InputError(
            f"graduations that stand out: {len(peaks)}; at least {_FEWEST_LINES} are needed. Cut "
            "the image to the ruler, turn it so that the ruler runs along the rows, or measure by hand"
        )
    spacing = np.diff(peaks)
    multiple = spacing / np.median(spacing)
    if np.any(np.abs(multiple - np.rint(multiple)) > 0.25):
        raise InputError(
            f"the lines are not equally spaced ({spacing.min()} to {spacing.max()} px); cut the "
            "image to graduations of one kind"
        )
    centres = _near(profile, peaks.astype(float), np.median(spacing) / 2)
    half = np.median(np.diff(centres)) / 2
    bands = np.array_split(np.arange(grey.shape[0]), _BANDS)
    places = np.array([_near(grey[band].mean(axis=0), centres, half) for band in bands])
    at_middle, across = places.mean(axis=0), np.array([band.mean() for band in bands]) - 0.5 * (grey.shape[0] - 1)
    drifts = across @ (places - at_middle) / (across @ across)  # of every line
    tilt, u_tilt = float(np.arctan(drifts.mean())), float(drifts.std(ddof=1) / np.sqrt(drifts.size))
    number = np.rint((at_middle - at_middle[0]) / np.median(np.diff(at_middle)))
    fit, covariance = np.polyfit(number, at_middle, 1, cov=True)
    residual = at_middle - np.polyval(fit, number)
    pitch = Quantity(float(fit[0] * np.cos(tilt)), float(np.sqrt(covariance[0, 0]) * np.cos(tilt)), "px")
    return Ruler(pitch, Quantity(tilt, u_tilt, "rad"), at_middle, float(residual.std(ddof=2)))


def _near(profile: Floats, centres: Floats, half: float) -> Floats:
    """Refine every centre to the centroid of the profile above its own ground."""
    reach = max(2, int(half * 0.8))
    refined = np.array(centres, float)
    for _ in range(2):
        for i, centre in enumerate(refined):
            first = max(0, round(centre) - reach)
            window = profile[first : round(centre) + reach + 1]
            weight = window - np.percentile(window, 40)
            weight = np.clip(weight, 0.0, None)
            if weight.sum() > 0:
                refined[i] = first + np.average(np.arange(window.size), weights=weight)
    return refined
