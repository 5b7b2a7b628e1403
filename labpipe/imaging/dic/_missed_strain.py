"""Strain that the points around a rigid subset show, and what it makes of the subset's shift.

A pattern that lies mostly on one side of its point is carried off the point by a strain that the subset
does not follow. Its own residual may hide that in noise, or let it look like a blur; the displacements
of the points around show it many times more clearly.
"""

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._places import nearest
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._subset_kernel import AFFINE, MOTIONS
from labpipe.imaging.dic._subsets import STRAINS, Subsets

#: Points that tell the strain about one of them, itself included: at most, and at least.
_AROUND, _LEAST_AROUND = 16, 6
#: Least standard uncertainty of a displacement among them (px), so that none outweighs all others.
_LEAST_DEVIATION = 0.01
#: Standard uncertainties by which a strain differs from none.
_BY_CHANCE = 2.0
#: Scatter (px) about one rigid motion of all points below which there is no strain to look for.
_RIGID = 0.02
#: Share of the points that may lie farther off.
_OFF = 0.02
#: Share of the standard uncertainty from which a shift by strain is worth telling, and of the values that have it.
_WORTH, _MANY = 0.5, 0.1
#: Mean square of what is left of displacements about a plane, in their variances, up to which they lie on it, and
#: share of the points that show a strain where it is one of the specimen.
_ON_PLANE, _MOST = 3.0, 0.75
#: Share of such a shift that is not in proportion to the strain.
_BENT = 0.1
#: Values whose surroundings are looked at once; bounds the work arrays to some 50 MB.
_BLOCK = 60_000


def missed_shift(
    reference: Reference, value: Floats, deviation: Floats, model: NDArray[np.integer], is_found: Flags
) -> tuple[Floats, Floats]:
    """Shift [px] (frame, point, 2) of rigid subsets by the strain that they did not follow, and its variance [px²].

    Where it is not known whether it is a strain, as at the border of two bodies, it is all variance.

    ``reference``: the subsets; ``value``, ``deviation``: (frame, point, 2 or more) [px], displacements and their
    standard uncertainties; ``model``: integer (frame, point), what was solved for; ``is_found``: bool (frame,
    point), which displacements count.
    """
    subsets, (shift, spread) = reference.subsets, np.zeros((2, *model.shape, 2))
    is_one = np.ones((*model.shape, 1), bool)
    places = np.stack([subsets.x, subsets.y], axis=1) + reference.offset
    if len(places) < _LEAST_AROUND:
        return shift, spread
    around = nearest(places, places, min(_AROUND, len(places)))
    is_rigid = is_found & subsets.is_rigid & (model & AFFINE == 0)
    rows = np.flatnonzero(is_rigid.any(axis=1) & ~_move_as_one(places, value, deviation, is_found))
    moves = {int(code): _move_by_strain(subsets, int(code)) for code in np.unique(model[is_rigid])}
    step = max(_BLOCK // around.size, 1)
    for first in range(0, len(rows), step):
        block = rows[first : first + step]
        moved = value[block, :, :2], deviation[block, :, :2], is_found[block]
        strain, variance, is_one[block, :, 0] = _strain_around(places, around, *moved)
        for code, move in moves.items():
            for part, power, told in ((shift, move, strain), (spread, move**2, variance)):
                missed = np.einsum("nac,fnc->fna", power, told)
                part[block] += np.where((is_rigid[block] & (model[block] == code))[..., None], missed, 0.0)
    # chance has a strain here and there, and so have borders of bodies: one of the specimen most points show
    is_one &= (shift.any(axis=2).sum(axis=1) > _MOST * is_rigid.sum(axis=1))[:, None, None]
    return shift * is_one, np.where(is_one, spread + (_BENT * shift) ** 2, shift**2)


def told_of(missed: Floats, deviation: Floats, is_asked: Flags) -> str:
    """Tell that subsets which were asked to be rigid do not follow a strain; empty where they hardly miss one.

    ``missed``, ``deviation``: (frame, point) and (frame, point, 2 or more) [px], shift by strain, and standard
    uncertainties, of which it is part; NaN where there is no value; ``is_asked``: bool (point,), points whose
    shape was stated as rigid.
    """
    is_valued = np.isfinite(deviation[..., 0]) & is_asked
    is_moved = is_valued & (missed > _WORTH * np.hypot(deviation[..., 0], deviation[..., 1]))
    if not is_moved.sum() > _MANY * is_valued.sum():
        return ""
    most = float(missed[is_moved].max())
    return (
        f'the specimen is strained, which moves points of shape "rigid" by up to {most:.2g} px; that is '
        'taken off by what the points around tell of it: shape "auto" or "affine" follows it'
    )


def _move_as_one(places: Floats, value: Floats, deviation: Floats, is_found: Flags) -> Flags:
    """Frames (frame,) in which the points found, all together, hardly do more than shift and turn."""
    number = np.maximum(is_found.sum(axis=1), 1)[:, None]
    x, y = (np.where(is_found, axis - axis.mean(), 0.0) for axis in places.T)
    u, v = (np.where(is_found, value[..., k], 0.0) for k in range(2))
    x, y, u, v = (np.where(is_found, part - part.sum(axis=1)[:, None] / number, 0.0) for part in (x, y, u, v))
    turn = ((x * v - y * u).sum(axis=1) / np.maximum((x * x + y * y).sum(axis=1), 1e-30))[:, None]
    away = np.hypot(u + turn * y + 0.5 * turn**2 * x, v - turn * x + 0.5 * turn**2 * y)
    noise = np.where(is_found, np.hypot(deviation[..., 0], deviation[..., 1]), 0.0)
    return np.asarray((away > _RIGID + 3.0 * noise).sum(axis=1) <= _OFF * number[:, 0])


def _move_by_strain(subsets: Subsets, code: int) -> Floats:
    """Shift (point, 2, strain) [px] per strain along x, along y, and of shear, of subsets that do not follow it."""
    inverse = subsets.model(code).inverse[:, [0, 3]]
    return np.asarray((inverse @ subsets.products(code)[1][:, :, :MOTIONS]) @ STRAINS.T)


def _strain_around(
    places: Floats, around: Integers, value: Floats, deviation: Floats, is_found: Flags
) -> tuple[Floats, Floats, Flags]:
    """Strain (frame, point, 3) along x, along y, and shear, 0 where it may be chance, its variance, and if it is one.

    The displacements around each point are fitted by a plane; where they do not lie on one, as at the border
    of two bodies, their scatter makes the strain uncertain, and their step is none.
    """
    weight = is_found / np.maximum(np.square(deviation).sum(axis=2), 2.0 * _LEAST_DEVIATION**2)
    weight = np.where(is_found, weight, 0.0)[:, around]
    count = np.count_nonzero(weight, axis=2)
    total = np.maximum(weight.sum(axis=2), 1e-30)
    moved = np.where(is_found[..., None], value, 0.0)[:, around]
    x, y = np.moveaxis(places[around] - places[:, None], 2, 0)
    u, v = moved[..., 0], moved[..., 1]
    x, y, u, v = (part - ((weight * part).sum(axis=2) / total)[..., None] for part in (x, y, u, v))
    xx, yy, xy = (np.einsum("fnk,fnk,fnk->fn", weight, a, b) for a, b in ((x, x), (y, y), (x, y)))
    slope = np.maximum(xx * yy - xy**2, 1e-12 * np.maximum(xx * yy, 1e-30))
    gradient = []
    for part in (u, v):
        by_x, by_y = (np.einsum("fnk,fnk,fnk->fn", weight, part, axis) for axis in (x, y))
        gradient.append(((by_x * yy - by_y * xy) / slope, (by_y * xx - by_x * xy) / slope))
    (u_x, u_y), (v_x, v_y) = gradient
    left = sum(
        np.einsum("fnk,fnk->fn", weight, np.square(part - a[..., None] * x - b[..., None] * y))
        for part, (a, b) in zip((u, v), gradient, strict=True)
    )
    spread = np.maximum(left / np.maximum(count - 3, 1), 1.0)
    variance = np.stack([yy, xx, 0.25 * (xx + yy)], axis=2) * (spread / slope)[..., None]
    # of Green and Lagrange, which no turn changes
    along_x = u_x + 0.5 * (u_x**2 + v_x**2)
    along_y = v_y + 0.5 * (u_y**2 + v_y**2)
    shear = 0.5 * (u_y + v_x + u_x * u_y + v_x * v_y)
    strain = np.stack([along_x, along_y, shear], axis=2)
    is_told = (strain**2 > _BY_CHANCE**2 * variance) & (count >= _LEAST_AROUND)[..., None]
    return np.where(is_told, strain, 0.0), np.where(is_told, variance, 0.0), spread < _ON_PLANE
