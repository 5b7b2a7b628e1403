"""The subsets of the reference and what their normal equations are inverted to.

A frame may differ from the reference by more than a motion: the light may slope or curve across a subset,
the blur may have changed. To first order each is a sum of images of the reference, the columns of
:data:`COLUMNS`, whose weights are found together with the motion where the residual shows them.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._subset_kernel import AFFINE, BLUR, COLUMNS, CURVE, CURVED, LIGHT, MOTIONS

# Below this the motion is not determined in every direction (a single edge, a flat subset).
_LEAST_EIGENVALUE = 1e-4
# Slopes below this share of the grey level per px are rounding errors of float32.
_LEAST_SLOPE = 1e-4

_RIGID_FROM_AFFINE = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, -1, 0, 1, 0]], float)
#: Stretch along x and y, and shear.
STRAINS = np.array([[0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1], [0, 0, 1, 0, 1, 0]], float)
_LIGHT_COLUMNS, _BLUR_COLUMNS = slice(MOTIONS, MOTIONS + 4), slice(MOTIONS + 4, COLUMNS)
_CURVE_COLUMNS = slice(COLUMNS, CURVED)


@dataclass(frozen=True)
class Images:
    """The reference and what the columns are made of, float32 arrays (row, column).

    Attributes
    ----------
    grey : array
        Grey levels.
    slope_x, slope_y : arrays
        Of the spline at the pixels.
    bend : array (3, row, column)
        Second derivatives of the softened reference: their sum, their difference along x and y,
        and the mixed one.
    inside : array, optional
        0 where a mask covers the reference, else 1.
    """

    grey: Floats32
    slope_x: Floats32
    slope_y: Floats32
    bend: Floats32
    inside: Floats32 | None = None


@dataclass(frozen=True)
class Model:
    """What is solved for.

    Attributes
    ----------
    inverse : array (point, column, column)
        Inverse of the normal matrix within the allowed columns; zero where there is no texture.
    tester : array (point, 13, 13)
        Turns the weights of a group of columns, or what they leave undone when they are not
        solved for, into the fall of the residual: four of the light, three of the blur, three of the
        strain, three of light that curves.
    """

    inverse: Floats
    tester: Floats


@dataclass(frozen=True)
class Subsets:
    """Everything that the solver needs of the reference, computed once.

    Attributes
    ----------
    layout : integer array (point, 6)
        Centre pixel x and y, half width (px; the subset is ``2 half + 1`` wide), place in the
        packed arrays, length of a row there, and 1 where a mask covers part of it.
    is_rigid : bool array (point,)
        Translation and rotation, or the full affine motion.
    packed : float32 array (7, ...)
        Grey levels less their mean, slope in x, slope in y, the three bends, and 0 where a pixel
        is covered; rows filled up with zeros.
    level : array (point, 3)
        Mean grey level, sum of squares about it, number of pixels.
    moments : array (point, 2, column)
        Sums of the columns, alone and times the grey level.
    normal : array (point, column, column)
        Normal matrix of the columns, gain and offset eliminated.
    spread : array (point, 3, 3)
        Sums of the products of (1, j, i).
    """

    layout: Integers
    is_rigid: NDArray[np.bool_]
    packed: Floats32
    level: Floats
    moments: Floats
    normal: Floats
    spread: Floats
    _models: dict[int, Model] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        """Return the number of subsets."""
        return len(self.layout)

    @property
    def x(self) -> Integers:
        """Column of each centre (px)."""
        return self.layout[:, 0]

    @property
    def y(self) -> Integers:
        """Row of each centre (px)."""
        return self.layout[:, 1]

    @property
    def half(self) -> Integers:
        """Half width of each subset (px)."""
        return self.layout[:, 2]

    @property
    def inverse(self) -> Floats:
        """Inverse of the normal matrix of the motion alone (point, 6, 6)."""
        return self.model(0).inverse[:, :MOTIONS, :MOTIONS]

    def model(self, code: int) -> Model:
        """Matrices of a model: the sum of ``LIGHT``, ``BLUR``, ``AFFINE`` and ``CURVE`` that it solves for."""
        if code not in self._models:
            self._models[code] = self._prepared(code)
        return self._models[code]

    def rigid_in(self, code: int) -> Flags:
        """Which subsets (point,) only shift and turn in a model."""
        return self.is_rigid & (code & AFFINE == 0)

    def products(self, code: int) -> tuple[Floats, Floats]:
        """Moments and normal matrices of a model, with the columns of light that curves where it has light."""
        return self._curved if code & (LIGHT | CURVE) else (self.moments, self.normal)

    @cached_property
    def _curved(self) -> tuple[Floats, Floats]:
        """Moments and normal matrices of all columns: light that curves is asked for only where it changes."""
        gram = np.empty((len(self), CURVED - COLUMNS, CURVED + 2))
        for n, (_, _, half, place, pitch, _) in enumerate(self.layout.tolist()):
            width = 2 * half + 1
            grey, slope_x, slope_y, *bends, weight = self.packed[:, place : place + width * pitch].reshape(7, width, -1)
            j = np.arange(pitch, dtype=np.float32) - half
            i = np.arange(-half, half + 1, dtype=np.float32)[:, None]
            motions = [part for slope in (slope_x, slope_y) for part in (slope, slope * j, slope * i)]
            whole = grey + np.float32(self.level[n, 0]) * weight
            mean = np.float32(half * (half + 1) / 3.0)
            curved = [whole * (j * j - mean), whole * j * i, whole * (i * i - mean)]
            light = [weight * j, weight * i, grey * j, grey * i]
            every = np.stack([weight, grey, *motions, *light, *bends, *curved]).reshape(CURVED + 2, -1)
            gram[n] = every[-3:] @ every.T
        ones, greys, own = gram[:, :, 0], gram[:, :, 1], gram[:, :, 2:]
        moments = np.concatenate([self.moments, np.stack([ones, greys], axis=1)], axis=2)
        _, energy, pixels = (part[:, None, None] for part in self.level.T)
        own = own - ones[:, :, None] * moments[:, None, 0] / np.maximum(pixels, 1.0)
        own -= greys[:, :, None] * moments[:, None, 1] / np.where(energy > 0, energy, 1.0)
        normal = np.empty((len(self), CURVED, CURVED))
        normal[:, :COLUMNS, :COLUMNS] = self.normal
        normal[:, COLUMNS:], normal[:, :, COLUMNS:] = own, own.transpose(0, 2, 1)
        return np.ascontiguousarray(moments), normal

    def _prepared(self, code: int) -> Model:
        _, normal = self.products(code)
        inverse = np.zeros_like(normal)
        tester = np.zeros((len(self), 13, 13))
        is_rigid = self.rigid_in(code)
        for group, motions in ((is_rigid, _RIGID_FROM_AFFINE), (~is_rigid, np.eye(MOTIONS))):
            if group.any():
                inverse[group] = _invert(normal[group], _basis(code, motions, normal.shape[1]))
        diagonal = np.diagonal(normal, axis1=1, axis2=2)
        least = self.level[:, 2] * (_LEAST_SLOPE * self.level[:, 0]) ** 2
        inverse[(diagonal[:, 0] <= least) | (diagonal[:, 3] <= least)] = 0.0
        left = normal - normal @ inverse @ normal
        strains = inverse[:, :MOTIONS, :MOTIONS], left[:, :MOTIONS, :MOTIONS]
        # the mean of both halves of a shear
        halves = STRAINS / STRAINS.sum(axis=1, keepdims=True)
        tester[:, :4, :4] = _weighed(code & LIGHT, inverse, left, _LIGHT_COLUMNS)
        if code & BLUR:
            tester[:, 4:7, 4:7] = _weighed(1, inverse, left, _BLUR_COLUMNS)
        else:
            tester[:, 4:5, 4:5] = _weighed(0, inverse, left, slice(_BLUR_COLUMNS.start, _BLUR_COLUMNS.start + 1))
        solved, open_ = halves @ strains[0] @ halves.T, STRAINS @ strains[1] @ STRAINS.T
        tester[:, 7:10, 7:10] = _inverted(solved if code & AFFINE else open_)
        tester[~self.is_rigid, 7:10, 7:10] = 0.0
        if normal.shape[1] > COLUMNS:
            tester[:, 10:, 10:] = _weighed(code & CURVE, inverse, left, _CURVE_COLUMNS)
        return Model(inverse, tester)


def _basis(code: int, motions: Floats, columns: int) -> Floats:
    """Rows are what a model solves for, in terms of all columns."""
    every = np.eye(columns)
    rows = [motions @ every[:MOTIONS]]
    rows += [every[_LIGHT_COLUMNS]] if code & LIGHT else []
    rows += [every[_BLUR_COLUMNS]] if code & BLUR else []
    rows += [every[_CURVE_COLUMNS]] if code & CURVE else []
    return np.concatenate(rows)


def adaptable(shapes: NDArray[np.str_], adapt: bool) -> Integers:
    """Tell for points of given shapes what may be solved for where it is needed."""
    return np.where(shapes == "auto", AFFINE, 0) | ((LIGHT | BLUR | CURVE) if adapt else 0)


def solved_columns(code: int) -> int:
    """Count the columns of light and blur that a model solves for."""
    return (4 if code & LIGHT else 0) + (3 if code & BLUR else 0) + (3 if code & CURVE else 0)


def _weighed(is_solved: int, inverse: Floats, left: Floats, columns: slice) -> Floats:
    return _inverted((inverse if is_solved else left)[:, columns, columns])


def _inverted(matrices: Floats) -> Floats:
    """Inverses of small symmetric matrices, nearly singular ones with a floor."""
    scale = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 0.0))
    balance = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    both = balance[:, :, None] * balance[:, None, :]
    return np.asarray(np.linalg.inv(matrices * both + _LEAST_EIGENVALUE * np.eye(scale.shape[1])) * both)


def _invert(normal: Floats, basis: Floats) -> Floats:
    """Invert within a basis; zero where the subset does not determine it."""
    reduced = basis @ normal @ basis.T
    scale = np.sqrt(np.maximum(np.diagonal(reduced, axis1=1, axis2=2), 0.0))
    return basis.T @ _balanced_inverse(reduced, scale) @ basis


def _balanced_inverse(matrices: Floats, scale: Floats) -> Floats:
    balance = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    balanced = matrices * balance[:, :, None] * balance[:, None, :]
    # With ones on the diagonal the smallest eigenvalue measures how independent the columns are.
    is_solvable = np.linalg.eigvalsh(balanced)[:, 0] > _LEAST_EIGENVALUE
    inverse = np.zeros_like(matrices)
    inverse[is_solvable] = np.linalg.inv(balanced[is_solvable])
    inverse *= balance[:, :, None] * balance[:, None, :]
    return inverse


def invert_within(normal: Floats, is_rigid: NDArray[np.bool_]) -> Floats:
    """Invert normal matrices within the motions that each subset is allowed.

    ``normal``: (point, 6, 6), normal matrices of the affine motion; ``is_rigid``: bool (point,), which subsets
    shift and turn only.

    Returns array (point, 6, 6), zero where the subset does not determine its motion.
    """
    inverse = np.zeros_like(normal)
    for group, motions in ((is_rigid, _RIGID_FROM_AFFINE), (~is_rigid, np.eye(MOTIONS))):
        if group.any():
            inverse[group] = _invert(normal[group], motions)
    return inverse
