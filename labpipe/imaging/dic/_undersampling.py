"""What edges sharper than the pixels do to the motion: moiré along them, and errors of interpolation.

Waves that are too short for the pixels appear folded, and no interpolation between pixels brings
them back. How much there is beyond half a wave per px follows from what the reference holds close
below it, without its noise.
"""

import math

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._motion_uncertainty import strongest_slopes
from labpipe.imaging.dic._reference import Reference, near_half

#: Squared slopes that an edge sharper than the pixels seems to have along itself, over those across it, by
#: the share of those at frequencies near half a wave per px: factor, power, and largest share. They are the most
#: of edges and lines of any angle, seen by points, by pixels, and by lenses that blur by 0.3 to 0.8 px.
_FOLDED, _FOLDED_POWER, _MOST_SHARP = 25.0, 2.5, 0.13
#: Shift (px) to which they mislead where they are little of the texture, and the share of it from which nothing
#: else is told: of results with more, half were off by 0.2 px or more, some by tens.
_MISLEADS, _ALL_FOLDED = 0.16, 0.35
#: Ratios of the slopes in both directions from which a pattern begins to count as edges of one direction, and
#: from which it is; also of edges seen by points, and the shares from which they begin to be that, and are.
_SIDED, _SIDED_OF_POINTS, _POINTS = (8.0, 11.0), (4.0, 6.0), (0.1, 0.13)
#: Share of the squared slopes near half a wave per px above which interpolation may err, and what it then leaves
#: of them at least: 0.08 to 0.6 where edges are sharper than the pixels, 0.02 where a lens blurs them.
_NOTABLE_SHARE, _LEAST_LEFT = 0.02, 0.05
#: What interpolation leaves, over the squares near half a wave per px, from which a pattern may be seen by points
#: instead of pixels, and from which it is, or something else misfits: 0.1 to 0.5 of scenes seen by pixels, 0.6 to 3
#: of those seen by points, whose parts err more alike than their scatter tells.
_LEFT_BY_POINTS, _ALIKE_BY_POINTS = (0.45, 0.8), 3.0
#: Shift (px) below which it is not looked whether edges sharper than the pixels mislead.
_NOTABLE = 1e-4


def misled(sharpness: Floats, texture: Floats, across: Floats) -> Floats:
    """Shift [px] along the weakest direction to which the moiré of edges sharper than the pixels misleads.

    Folded waves of an edge make steps along it, a texture that stays with the pixels while the edge
    moves on, and leaves no misfit where there is nothing else along it. It misleads by its share of the
    texture, and without limit where it may be a third of it.

    Parameters
    ----------
    sharpness : array [grey²/px²]
        Squares of the reference near half a wave per px without its noise, see :func:`near_half`.
    texture : array [grey²/px²]
        As in :class:`.Variances`: where a stretch or a turn would explain it, it tells no shift.
    across : array [grey²/px²]
        See :func:`.strongest_slopes`.
    """
    sided = across / np.maximum(texture, 1e-30)
    share = np.maximum(sharpness / np.maximum(across, 1e-30), 0.0)
    by_points = _seen_by_points(share)
    first, last = (a + by_points * (b - a) for a, b in zip(_SIDED, _SIDED_OF_POINTS, strict=True))
    is_edge = np.clip((sided - first) / (last - first), 0.0, 1.0)
    folded = is_edge * _FOLDED * np.minimum(share, _MOST_SHARP) ** _FOLDED_POWER * sided
    left = 1.0 - folded / _ALL_FOLDED
    return np.where(left > 0.0, _MISLEADS * folded / np.where(left > 0.0, left, 1.0), np.inf)


def _seen_by_points(share: Floats) -> Floats:
    """How far (0 to 1) a share near half a wave per px exceeds what pixels with an area show."""
    return np.asarray(np.clip((share - _POINTS[0]) / (_POINTS[1] - _POINTS[0]), 0.0, 1.0))


def undersampled(reference: Reference, found: Flags, texture: Floats, noise: Floats, is_static: Flags) -> Floats:
    """Shift along the weakest direction to which edges sharper than the pixels mislead.

    Parameters
    ----------
    reference : Reference
    found : bool array (frame, usable point)
        Results that are asked about.
    texture, noise : arrays (frame, usable point)
        As in :class:`.Variances`.
    is_static : bool array (frame,)

    Returns
    -------
    array (frame, usable point) [px]
        See :func:`misled`.
    """
    sharp, of_noise = near_half(reference)
    across = strongest_slopes(reference.subsets)
    shift = np.zeros(found.shape)
    least = np.where(found, texture, np.inf).min(axis=0, initial=np.inf)
    total = reference.sums(sharp)
    is_notable = misled(total, least, across) > _NOTABLE
    for n in np.flatnonzero(is_notable & np.isfinite(least)).tolist():
        slopes = reference.subsets.normal[n]
        weakest = 0.5 * (math.atan2(2.0 * slopes[0, 3], slopes[0, 0] - slopes[3, 3]) + math.pi)
        own, _ = reference.own_noise(n, noise[is_static, n], weakest)
        rows = found[:, n]
        # what one image shows of noise may be its pattern, what the residual shows a misfit
        own = min(own, float(np.median(noise[rows, n])))
        less = total[n] - of_noise * own * reference.subsets.level[n, 2]
        shift[rows, n] = misled(less, texture[rows, n], across[n])
    return shift


class Sharpness:
    """Tells from what a solution leaves whether interpolation between too few pixels errs.

    Parameters
    ----------
    reference : Reference

    Attributes
    ----------
    may_err : bool array (usable point,)
        Where enough of the reference lies near half a wave per px.
    """

    def __init__(self, reference: Reference) -> None:
        sharp, self._of_noise = near_half(reference)
        self._reference = reference
        self._total, self._least = reference.sums(sharp), _NOTABLE_SHARE * strongest_slopes(reference.subsets)
        self.may_err = self._total > self._least
        self._own = np.full(len(self._total), np.nan)

    def judge(self, residual: Floats) -> tuple[Flags, Flags, Floats]:
        """Whether interpolation errs (point,), whether that is all that misfits, and a factor of variances.

        The factor is that of patterns seen by points, which err alike. ``residual`` is as in :class:`.Solution`.
        """
        reference = self._reference
        pixels = reference.subsets.level[:, 2]
        for _ in range(2):
            # what one image shows of noise may be its pattern
            own = np.fmin(self._own, residual / (reference.noise.seen * pixels))
            sharp = np.maximum(self._total - self._of_noise * own * pixels, 0.0)
            errs = self.may_err & (sharp > self._least) & (residual > _LEAST_LEFT * sharp)
            fresh = np.flatnonzero(errs & np.isnan(self._own)).tolist()
            if not fresh:
                break
            for n in fresh:
                self._own[n] = reference.own_noise(n, np.zeros(0), 0.0)[0]
        self._own = np.where(np.isnan(self._own), np.nan, own)
        left = (residual - reference.noise.seen * own * pixels) / np.maximum(sharp, 1e-30)
        first, last = _LEFT_BY_POINTS
        by_points = np.where(errs, np.clip((left - first) / (last - first), 0.0, 1.0), 0.0)
        factor = 1.0 + (_ALIKE_BY_POINTS - 1.0) * by_points
        return errs, errs & (left < last), factor
