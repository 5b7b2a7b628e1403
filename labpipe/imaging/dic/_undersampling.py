"""What edges sharper than the pixels do to the motion: moiré along them, and errors of interpolation.

Waves that are too short for the pixels appear folded, and no interpolation between pixels brings
them back. How much there is beyond half a wave per px follows from what the reference holds close
below it, without its noise.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._motion_uncertainty import strongest_slopes
from labpipe.imaging.dic._reference import Reference

#: Squared slopes that an edge sharper than the pixels seems to have along itself, over those across it, by
#: the share of those at frequencies near half a wave per px: factor, power, and largest share. They are the most
#: of edges and lines of any angle, seen by points, by pixels, and by lenses that blur by 0.3 to 0.8 px.
_FOLDED, _FOLDED_POWER, _MOST_SHARP = 25.0, 2.5, 0.13
#: Ratios of the slopes in both directions from which a pattern begins to count as edges of one direction, and
#: from which it is; also of edges seen by points, and the shares from which they begin to be that, and are.
_SIDED, _SIDED_OF_POINTS, _POINTS = (8.0, 11.0), (4.0, 6.0), (0.1, 0.13)
#: Share of the squared slopes near half a wave per px below which interpolation is exact enough, and from which
#: every point is looked at: it is 0.009 to 0.03 where a lens blurs sharp edges by 0.7 px. Of fine speckle that a lens
#: shows, 0.05, so many points tell whether interpolation errs.
_NOTABLE_SHARE, _SHARP_SHARE, _SAMPLE = 0.008, 0.03, 16
#: Excess of the residual over noise from which they do, as a share of the noise.
_MISFITS = 0.2
#: Factor of the variance from interpolation between points: waves are folded as far as the spectrum reaches.
_BETWEEN_POINTS = 16.0
#: Share of the variance of lines that err alike: those seen by pixels err less than they are sharp.
_ALIKE = 0.5
#: Ratio of what is left near half a wave per px by differences of twice the order from which interpolation
#: errs, and from which it errs as much as that: 0.2 to 0.3 in photographs, 0.4 in the finest speckle that a lens
#: shows and random fields blurred by 0.7 px, 0.57 in edges seen by pixels, 0.67 in those seen by points.
_RATIO = (0.4, 0.5)
#: Variance of a motion from interpolation that errs by as much as the residual exceeds noise, over that of
#: errors which no pixels share; and the standard deviations by which it exceeds noise by chance.
_SHARED, _BY_CHANCE = 6.0, 3.0
#: Share of frames that show a point's own noise, and the variance (grey²) of rounding, and that below which
#: even rounding is none of it: then most of the subset is flat, and what is left lies at its edges.
_BETTER, _HARDLY = 0.1, 0.8
#: Noise that hides such an error, in its own variances, and the mean size of noise over its deviation.
_HIDES, _MEAN_SIZE = 1.5, 0.8
#: Standard uncertainty (px) of a motion that edges seen by points along the columns or rows may hide, all at once:
#: what lies between two pixels, of a block of whole pixels, no one can tell. Half a px is hidden at most.
_UNSEEN = 0.16
#: Share of the slopes that lies in such edges above which they hide anything, and from which all of it: a texture of
#: no direction has 0.05, and mostly up to 0.15 in photographs; rows of squares and of bricks have 0.2 and more.
_IN_LINE = (0.12, 0.2)
#: Slope of an edge against the columns or rows below which all its pixels are seen at one phase.
_ALIGNED = 0.06
#: The same below which few of them are seen at different phases.
_NEARLY = 0.3
#: Share of the texture below which it is not looked how far edges sharper than the pixels may be it.
_NOTABLE = 1e-3


def folded_share(sharpness: Floats, texture: Floats, across: Floats) -> Floats:
    """Largest share (0 to 1) of the texture along the weakest direction that edges sharper than the pixels make.

    Folded waves of an edge make steps along it, a texture that stays with the pixels while the edge
    moves on, and leaves no misfit where there is nothing else along it.

    ``sharpness``: [grey²/px²], squares of the reference near half a wave per px without its noise, see
    :func:`near_half`; ``texture``: [grey²/px²], as in :class:`.Variances`: where a stretch or a turn would
    explain it, it tells no shift; ``across``: [grey²/px²], see :func:`.strongest_slopes`.
    """
    sided = across / np.maximum(texture, 1e-30)
    share = np.maximum(sharpness / np.maximum(across, 1e-30), 0.0)
    by_points = _seen_by_points(share)
    first, last = (a + by_points * (b - a) for a, b in zip(_SIDED, _SIDED_OF_POINTS, strict=True))
    is_edge = np.clip((sided - first) / (last - first), 0.0, 1.0)
    return np.asarray(np.minimum(is_edge * _FOLDED * np.minimum(share, _MOST_SHARP) ** _FOLDED_POWER * sided, 1.0))


def _seen_by_points(share: Floats) -> Floats:
    """How far (0 to 1) a share near half a wave per px exceeds what pixels with an area show."""
    return np.asarray(np.clip((share - _POINTS[0]) / (_POINTS[1] - _POINTS[0]), 0.0, 1.0))


def interpolates_well(reference: Reference, noise: Floats) -> Flags:
    """Tell points (usable point,) that hold so little near half a wave per px that no misfit is one of interpolation.

    ``noise``: (usable point,) [grey²], variance of a pixel of one frame.
    """
    sums, of_noise, least = sharpness(reference)
    return np.asarray(sums - of_noise * noise * reference.subsets.level[:, 2] < least)


def sharpness(reference: Reference) -> tuple[Floats, float, Floats]:
    """Squares near half a wave per px (usable point,), those of noise over its sum, and the least that matter."""
    return *reference.sharp_sums, _NOTABLE_SHARE * strongest_slopes(reference.subsets)


def undersampled(
    reference: Reference, found: Flags, texture: Floats, noise: Floats, is_static: Flags, is_taken: Flags
) -> tuple[Floats, Floats]:
    """How far edges sharper than the pixels may be what tells a motion, and how uncertain interpolation makes it.

    ``found``: bool (frame, usable point), results that are asked about; ``texture``, ``noise``: (frame, usable
    point), as in :class:`.Variances`; ``is_static``: bool (frame,); ``is_taken``: bool (frame, usable point), see
    :func:`.take_spread`: only what no residual shows is left to tell.

    Returns ``bound``: (frame, usable point), see :func:`folded_share`; ``covariance``: (frame, usable point, 3)
    [px²], variances along x and along y, and the covariance, from errors of interpolation.

    Notes
    -----
    How much interpolation errs is known beforehand only of what is sharper than the pixels. Of what a lens
    blurs a little, the residual tells it: beyond noise it holds what the frame and the reference, seen at other
    phases of the pixels, do not share.
    """
    total, of_noise = reference.sharp_sums
    sharper, of_sharper_noise = reference.sharper
    finest = reference.sums(sharper)
    across = strongest_slopes(reference.subsets)
    bound, covariance = np.zeros(found.shape), np.zeros((*found.shape, 3))
    least = np.where(found, texture, np.inf).min(axis=0, initial=np.inf)
    is_sharp = (folded_share(total, least, across) > _NOTABLE) | (
        (total > _SHARP_SHARE * across) & (finest > _RATIO[0] * total)
    )
    is_asked = np.isfinite(least)
    blurred = np.flatnonzero(~is_sharp & (total > _NOTABLE_SHARE * across) & is_asked)
    sample = blurred[np.unique(np.linspace(0, len(blurred) - 1, _SAMPLE).astype(int))] if len(blurred) else blurred
    rest = np.setdiff1d(blurred, sample)
    misfits = False
    for n in [*np.flatnonzero(is_sharp & is_asked).tolist(), *sample.tolist(), *rest.tolist()]:
        if len(rest) and n == rest[0] and not misfits:
            break  # fine speckle that a lens shows
        own, _ = reference.own_noise(n, noise[is_static, n])
        if reference.noise.static_frames > 1 and not noise[is_static, n].any():
            own = min(own, reference.rounding)  # frames that are equal to the last bit
        shown = own
        rows = found[:, n]
        pixels = float(reference.subsets.level[n, 2])
        # what one image shows of noise may be its pattern, what the residual of a frame shows a misfit
        least_seen = float(np.quantile(noise[rows, n], _BETTER))
        own = min(own, least_seen, finest[n] / (of_sharper_noise * pixels))
        if least_seen < _HARDLY * reference.rounding:
            own = 0.0
        less = total[n] - of_noise * own * pixels
        bound[rows, n] = folded_share(less, texture[rows, n], across[n])
        ratio = (finest[n] - of_sharper_noise * own * pixels) / max(less, 1e-30)
        weight = float(np.clip((ratio - _RATIO[0]) / (_RATIO[1] - _RATIO[0]), 0.0, 1.0))
        beyond = np.maximum(noise[rows, n] - own * (1.0 + _BY_CHANCE * math.sqrt(2.0 / pixels)), 0.0) * pixels
        misfits |= bool(np.median(beyond) > _MISFITS * own * pixels)
        seen = _SHARED * np.minimum(beyond / max(less, 1e-30), 1.0) * (less > _NOTABLE_SHARE * across[n])
        by_points = weight * float(_seen_by_points(less / across[n]))
        # what interpolation misses is in the residual, beyond a noise that shows none of it
        least_own = shown if reference.noise.static_frames > 1 else reference.rounding
        most = noise[rows, n] - least_own * (1.0 - _BY_CHANCE * math.sqrt(2.0 / pixels))
        most = _SHARED * np.maximum(most, 0.0) * pixels / max(less, 1e-30)
        amplitude = weight * np.minimum(_BETWEEN_POINTS**by_points, most) + (1.0 - weight) * seen
        if amplitude.any():
            spread, alike, unseen = _interpolated(reference, n, reference.sharp[0], of_noise * own)
            spread = np.where(is_taken[rows, n, None], alike, spread + alike)
            covariance[rows, n] = amplitude[:, None] * spread + by_points * unseen
    return bound, covariance


def _interpolated(
    reference: Reference, point: int, sharp: NDArray[np.float64], noise: float
) -> tuple[Floats, Floats, Floats]:
    """Covariance (xx, yy, xy) [px²] of a motion from errors of interpolation; ``noise`` is that of ``sharp``.

    Also that of what edges seen by points hide which run with the rows, the columns, or the diagonals.

    Such errors are as large as what there is near half a wave per px, and lie where the slopes are: each
    moves the answer by its share of the slope, ``A⁻¹ (Σ g gᵀ e²) A⁻¹``. Along an edge that runs with the
    columns, the rows or the diagonals all pixels are seen at one phase, and make one error: as far as
    slopes are the same all along a line of pixels. Those of a photograph come and go.
    """
    x, y, half = reference.subsets.layout[point, :3]
    cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
    images = reference.images
    inside = 1.0 if images.inside is None else images.inside[cut].astype(float)
    slope_x, slope_y = images.slope_x[cut] * inside, images.slope_y[cut] * inside
    error = sharp[cut]
    pairs = ((slope_x, slope_x), (slope_y, slope_y), (slope_x, slope_y))
    own = np.array([float((a * b).sum()) for a, b in pairs])
    weighed = np.array([float((a * b * error).sum()) for a, b in pairs])
    beyond = 1.0 - _HIDES * noise * (own[0] + own[1]) / max(weighed[0] + weighed[1], 1e-30)
    if beyond <= 0.0:
        return np.zeros(3), np.zeros(3), np.zeros(3)
    normal = reference.subsets.normal[point][np.ix_([0, 3], [0, 3])]
    inverse = np.linalg.pinv(normal)
    spread = inverse @ np.array([[weighed[0], weighed[2]], [weighed[2], weighed[1]]]) @ inverse
    result = beyond * np.array([spread[0, 0], spread[1, 1], spread[0, 1]])
    alike, unseen = np.zeros((2, 3))
    size = np.maximum(np.sqrt(error) - _MEAN_SIZE * math.sqrt(noise), 0.0)
    row, column = np.indices(size.shape)
    for right, down in ((1, 0), (0, 1), (1, 1), (1, -1)):
        apart = 1.0 / math.hypot(right, down)  # of the lines of pixels
        along, other = apart * (right * slope_x + down * slope_y), apart * (down * slope_x - right * slope_y)
        lines = right * column + down * row
        lines -= lines.min()
        shown = np.abs(along) * size * (np.abs(other) <= _ALIGNED * np.abs(along))
        squares = float((np.bincount(lines.ravel(), shown.ravel()) ** 2).sum())
        is_nearly = np.abs(other) <= _NEARLY * np.abs(along)
        in_line = np.bincount(lines.ravel(), (np.abs(along) * is_nearly).ravel()) ** 2 / np.bincount(lines.ravel())
        share = float(in_line.sum()) / max(float((along**2).sum()), 1e-30)
        direction = apart**2 * np.array([right * right, down * down, right * down])
        resists = direction @ (normal[0, 0], normal[1, 1], 2.0 * normal[0, 1])
        alike += _ALIKE * share * squares / max(float(resists), 1e-30) ** 2 * direction
        hides = min(max((share - _IN_LINE[0]) / (_IN_LINE[1] - _IN_LINE[0]), 0.0), 1.0)
        unseen += hides * share * (_UNSEEN * apart) ** 2 * direction
    return result, alike, unseen
