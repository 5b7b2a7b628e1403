"""Assemble the tracked motions into the Dataset of displacements."""

import json
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._agreement import disagreement, unconfirmed
from labpipe.imaging.dic._edge_profile import misled
from labpipe.imaging.dic._growth import STEP
from labpipe.imaging.dic._hidden_steps import gathered_steps, hidden_steps
from labpipe.imaging.dic._misfit import hidden_by_levels, misfit_factor, still_noise, take_spread
from labpipe.imaging.dic._missed_strain import missed_shift
from labpipe.imaging.dic._motion_uncertainty import (
    MOST_UNCERTAIN,
    MOST_VAGUE,
    Variances,
    least_told,
    motion_variance,
    strongest_slopes,
    weakest_told,
)
from labpipe.imaging.dic._pattern import Pattern
from labpipe.imaging.dic._reference import Reference, Status
from labpipe.imaging.dic._seeding import shift_of
from labpipe.imaging.dic._subset_kernel import AFFINE, BLUR, CURVE, LIGHT
from labpipe.imaging.dic._table import Table, alike, as_seen, hidden_share
from labpipe.imaging.dic._undersampling import interpolates_well, undersampled
from labpipe.variables import described, variable

if TYPE_CHECKING:
    import xarray as xr


#: Range of the displacement over the static frames (px), median of the points, from which they
#: are not static.
_STATIC_RANGE = 0.3
#: Variance by what misfits because of a strain at most, over the mean square of the shift by that strain.
_MISFITS_BY = 16.0
#: Noise of a film over the lower quartile of what its points show: they scatter about as much.
_NOISE_OF_FILM = 0.9


@dataclass(frozen=True)
class Displacements:
    """Results over (frame, usable point); value and deviation hold (dx, dy, rotation) last, change both stretches.

    ``missed`` [px] is how far a strain that a subset does not follow moves it.
    """

    value: Floats
    deviation: Floats
    covariance: Floats
    texture: Floats
    zncc: Floats
    contrast: Floats
    iterations: NDArray[np.int32]
    status: NDArray[np.int8]
    model: NDArray[np.int8]
    change: Floats
    hidden: Floats
    missed: Floats

    def refuse(self, frames: NDArray[np.bool_], why: Status) -> None:
        """Take back what was found in frames (frame,)."""
        was_found = frames[:, None] & (self.status == Status.OK)
        self.status[was_found] = why
        for values in (self.value, self.deviation, self.covariance, self.change, self.hidden):
            values[was_found] = np.nan


def displacements(table: Table, reference: Reference, is_static: NDArray[np.bool_]) -> Displacements:
    """Displacements at the points relative to the mean of the static frames.

    Parameters
    ----------
    table : Table
        What the tracker found.
    reference : Reference
        What it looked for.
    is_static : bool array (frame,)
        Frames in which nothing moves.
    """
    shape = table.status.shape
    status = table.status.copy()
    stretch = np.zeros((*shape, 2))
    value = np.full((*shape, 3), np.nan)
    deviation = np.full((*shape, 3), np.nan)
    covariance, texture, strongest, noise, most_noise = np.full((5, *shape), np.nan)
    is_doubtful, resisted = np.zeros(shape, bool), np.ones((*shape, 3))
    for growth, model, row, column, left in alike(table, reference.subsets.half):
        pattern = reference.patterns.of(growth)
        motion = table.motion[row, column]
        value[row, column, :2] = shift_of(motion, reference.offset[column])
        value[row, column, 2] = np.arctan2(motion[:, 4] - motion[:, 2], 2.0 + motion[:, 1] + motion[:, 5])
        sides = np.stack([np.hypot(1.0 + motion[:, 1], motion[:, 4]), np.hypot(1.0 + motion[:, 5], motion[:, 2])], 1)
        stretch[row, column] = np.where(reference.subsets.rigid_in(model)[column, None], 0.0, sides - 1.0)
        slopes_left, kept = pattern.softened(column, table.change[row, column, 2:])
        found = motion_variance(
            *as_seen(pattern, column, left),
            motion,
            table.gain[row, column],
            table.residual[row, column],
            is_static[row],
            model,
            slopes_left,
            kept,
        )
        deviation[row, column] = np.sqrt(found.motion)
        covariance[row, column] = found.covariance
        resisted[row, column] = _resisted(reference, pattern, model, column, found, slopes_left)
        # as the reference shows it, where the frames are softer
        share = strongest_slopes(reference.subsets) / np.maximum(strongest_slopes(pattern.subsets), 1e-30)
        texture[row, column], strongest[row, column] = found.texture * share[column], found.strongest * share[column]
        status[row, column] = np.where(found.is_told, Status.OK, Status.TEXTURELESS)
        noise[row, column], most_noise[row, column] = found.noise, found.most_noise
        is_doubtful[row, column] = found.is_vague
    is_found = (status == Status.OK) & ~is_static[:, None]
    is_noise = np.isin(status, (Status.OK, Status.LOST)) & (reference.is_faint & ~is_found.any(axis=0))
    status[is_noise] = Status.TEXTURELESS
    grey, _, pixels = reference.subsets.level.T
    before, spread = still_noise(reference, noise, is_static)
    least = _hidden_steps(reference, value, is_found, table.spread / resisted)
    by_noise = deviation.copy(), covariance.copy()
    is_taken = take_spread(reference.subsets, deviation, covariance, table.spread / resisted, texture, strongest)
    still = np.where(interpolates_well(reference, before), before, np.inf), spread
    misfit = misfit_factor(noise, is_static, pixels, grey, still, texture, is_taken)
    covariance *= misfit**2
    deviation *= misfit[..., None]
    deviation[..., :2] = np.maximum(deviation[..., :2], np.sqrt(least))
    by_misfit = _by_misfit(reference, deviation, by_noise[0], before, noise)
    bound, shared = undersampled(reference, is_found, texture, noise, is_static, is_taken)
    shift, is_along_edges = misled(reference, is_found, bound, texture, noise, is_static)
    is_doubtful |= is_along_edges | _may_be_noise(reference, noise, most_noise, is_static)
    _widen(deviation, covariance, shift)
    _add(deviation, covariance, shared + hidden_by_levels(reference, noise) * is_found[..., None])
    missed, of_missed = missed_shift(reference, value, deviation, table.model, is_found & ~is_doubtful)
    _take_off(value, deviation, covariance, missed, of_missed, by_misfit)
    # where noise tells the motion, and interpolation or a misfit makes it so vague, the points around may know better
    is_doubtful |= _may_be_any(deviation)
    _ask_around(reference, status, value, deviation, covariance, by_noise, is_doubtful, is_static)
    _warn_of_motion(value[is_static], status[is_static])
    is_origin = is_static[:, None] & (status == Status.OK)
    seen = is_origin.sum(axis=0)
    total = np.where(is_origin[..., None], value, 0.0).sum(axis=0)
    # A point that no static frame shows has no origin to count its displacement from.
    status[:, seen == 0] = np.where(status[:, seen == 0] == Status.OK, Status.LOST, status[:, seen == 0])
    value -= total / np.maximum(seen, 1)[:, None]
    is_bad = status != Status.OK
    for values in (value, deviation, covariance):
        values[is_bad] = np.nan
    blur = np.concatenate([table.change[..., :2], table.change[..., 2:] + STEP * table.growth[:, None, :3]], axis=2)
    models = table.model | np.where(table.growth.any(axis=1, keepdims=True), BLUR, 0).astype(np.int8)
    change = np.where(is_bad[..., None], np.nan, np.concatenate([blur, stretch], axis=2))
    shares = np.where(is_bad, np.nan, hidden_share(table, reference.subsets.half))
    contrast = 1.0 / np.where(table.gain == 0.0, np.nan, table.gain)
    return Displacements(
        value,
        deviation,
        covariance,
        texture,
        table.zncc,
        contrast,
        table.iterations,
        status,
        models,
        change,
        shares,
        np.hypot(missed[..., 0], missed[..., 1]),
    )


def _places(reference: Reference) -> Floats:
    """Where the points (point, 2) [px] are in the reference."""
    return np.asarray(np.stack([reference.subsets.x, reference.subsets.y], axis=1) + reference.offset)


def _hidden_steps(reference: Reference, value: Floats, is_found: Flags, spread: Floats) -> Floats:
    """Tell the least variances (frame, point, 2) [px²] where edges moved on in whole pixels."""
    inverse = reference.subsets.inverse[:, [0, 3], [0, 3]]
    return np.maximum(gathered_steps(_places(reference), value, is_found), hidden_steps(is_found, spread, inverse))


def _resisted(
    reference: Reference, pattern: Pattern, model: int, column: Integers, found: Variances, left: Floats
) -> Floats:
    """Squares (result, 3) along x, along y, and of both, by which slopes that a frame lacks resist an error less.

    That is what a softer frame leaves of them, and what is noise of the reference.
    """
    of_noise = np.minimum(reference.most_noise[column], found.noise) / np.maximum(found.noise, 1e-30)
    of_noise *= 1.0 - found.texture / weakest_told(pattern.subsets, model)[column]
    return np.asarray(np.column_stack([left**2, left.prod(axis=1)]) * np.square(1.0 - of_noise)[:, None])


def _may_be_noise(reference: Reference, noise: Floats, most_noise: Floats, is_static: Flags) -> Flags:
    """Tell results (frame, point) whose texture noise may be: that of their residual, or of the film.

    The columns of light and blur can take noise for a change where there is hardly a pattern, so that what the
    film's noise would hide is not told either. What a point itself shows to be its noise tells a misfit from it.
    """
    moved = noise[~is_static]
    moved = moved[np.isfinite(moved)]
    of_film = _NOISE_OF_FILM * np.quantile(moved, 0.25) if len(moved) else 0.0
    result = np.asarray(most_noise < np.fmax(of_film, noise))
    for n in np.flatnonzero(result.any(axis=0)).tolist():
        own, _ = reference.own_noise(n, noise[is_static, n])
        result[:, n] &= most_noise[:, n] < own
    return result


def _ask_around(
    reference: Reference,
    status: NDArray[np.int8],
    value: Floats,
    deviation: Floats,
    covariance: Floats,
    by_noise: tuple[Floats, Floats],
    is_doubtful: Flags,
    is_static: Flags,
) -> None:
    """Widen, or refuse, what the points around contradict, and what is doubtful or vague and they do not confirm."""
    motions = _places(reference), 2 * reference.subsets.half + 1, value, deviation
    is_found = (status == Status.OK) & ~is_static[:, None]
    is_clear = is_found & ~is_doubtful & ~_may_be_any(deviation)
    _add(deviation, covariance, disagreement(*motions, is_clear))
    is_trusted = is_clear & ~_may_be_any(deviation)
    status[is_clear & ~is_trusted] = Status.OUTVOTED
    # one that several tops of the correlation may have is no doubt of where many agree, only where it stands alone
    is_vague = is_trusted & (np.hypot(deviation[..., 0], deviation[..., 1]) >= MOST_UNCERTAIN)
    is_asked = is_found & is_doubtful
    more = unconfirmed(*motions, is_trusted, is_asked | is_vague)
    status[is_vague & ~np.isfinite(more[..., 0])] = Status.OUTVOTED
    more[is_vague] = 0.0
    # how far what is confirmed lies from there tells its misfit, or what interpolation made of it, but no noise
    deviation[is_asked], covariance[is_asked] = (part[is_asked] for part in by_noise)
    _add(deviation, covariance, more)
    status[(status == Status.OK) & _may_be_any(deviation)] = Status.TEXTURELESS


def _by_misfit(reference: Reference, deviation: Floats, by_noise: Floats, before: Floats, noise: Floats) -> Floats:
    """Tell the variances (frame, point, 2) [px²] that motions have beyond those by the noise before anything moved."""
    quiet = np.minimum(np.minimum(before, reference.most_noise) / np.maximum(noise, 1e-30), 1.0)
    return np.maximum(deviation[..., :2] ** 2 - by_noise[..., :2] ** 2 * quiet[..., None], 0.0)


def _take_off(
    value: Floats, deviation: Floats, covariance: Floats, missed: Floats, spread: Floats, by_misfit: Floats
) -> None:
    """Take off a strain's shift that subsets missed, and from their variances what they misfit by because of it."""
    is_missed = np.asarray(missed.any(axis=2))
    if not spread.any():
        return
    usual = np.square(missed).sum(axis=(1, 2)) / np.maximum(2 * is_missed.sum(axis=1), 1)
    spare = np.where(by_misfit < _MISFITS_BY * usual[:, None, None], by_misfit, 0.0) * is_missed[..., None]
    value[..., :2] -= missed
    less = np.sqrt(1.0 - spare / np.maximum(deviation[..., :2] ** 2, 1e-30))
    covariance *= less.prod(axis=2)
    deviation[..., :2] = np.hypot(deviation[..., :2] * less, np.sqrt(spread))


def _widen(deviation: Floats, covariance: Floats, shift: Floats) -> None:
    """Add a standard uncertainty along the direction in which a motion is told least."""
    weakest = least_told(deviation, covariance)
    cosine, sine = shift * np.cos(weakest), shift * np.sin(weakest)
    deviation[..., 0], deviation[..., 1] = np.hypot(deviation[..., 0], cosine), np.hypot(deviation[..., 1], sine)
    covariance += cosine * sine


def _add(deviation: Floats, covariance: Floats, more: Floats) -> None:
    """Add variances along x and along y and a covariance (last axis) to those of the motions."""
    if more.any():
        deviation[..., :2] = np.hypot(deviation[..., :2], np.sqrt(more[..., :2]))
        covariance += more[..., 2]


def _may_be_any(deviation: Floats) -> Flags:
    """Tell displacements that are so uncertain that they may be any."""
    return np.asarray(np.hypot(deviation[..., 0], deviation[..., 1]) > MOST_VAGUE)


def _warn_of_motion(static: Floats, status: NDArray[np.int8]) -> None:
    """Warn when the frames behind the reference move."""
    whole = (status == Status.OK).all(axis=0)
    if len(static) < 2 or not whole.any():
        return
    spread = float(np.median(np.ptp(static[:, whole, :2], axis=0).max(axis=1)))
    if spread > _STATIC_RANGE:
        warnings.warn(
            f"the {len(static)} static frames move by {spread:.2f} px, so that their mean is a "
            "blurred reference: take fewer static frames",
            UserWarning,
            stacklevel=4,
        )


def make_dataset(
    time: Floats,
    places: Floats,
    half: NDArray[np.int64],
    indices: NDArray[np.int64],
    wanted: NDArray[np.int64],
    found: Displacements,
    reference: Reference,
    work: dict[str, int],
    note: str,
) -> "xr.Dataset":
    """Assemble the Dataset over (frame, point).

    Parameters
    ----------
    time : array of all frames [s]
    places : array (point, 2) [px]
    half : integer array (point,) [px]
    indices : integer array
        Frames that were tracked.
    wanted : integer array
        Those of them that are asked for.
    found : Displacements
        Over (tracked frame, usable point).
    reference : Reference
        Tells which points were usable and what is wrong with the others.
    work : dict
        Counts for the attribute ``work``.
    note : str
        What a reader must know of the film.
    """
    import xarray as xr

    rows = np.searchsorted(indices, wanted)
    shape = (len(wanted), len(places))

    def spread(values: NDArray[np.generic], missing: float) -> NDArray[np.generic]:
        result = np.full(shape, missing, values.dtype)
        result[:, reference.usable] = values[rows]
        return result

    status = np.tile(reference.status, (shape[0], 1))
    status[:, reference.usable] = found.status[rows]
    texts = {
        "dx": ("px", "displacement to the right"),
        "dy": ("px", "displacement downwards"),
        "rotation": ("rad", "rotation from x towards y"),
    }
    variables: dict[str, Any] = {}
    dims = ("frame", "point")
    for k, (name, (units, text)) in enumerate(texts.items()):
        attrs: dict[str, object] = described(units, text)
        variables[name] = (dims, spread(found.value[..., k], np.nan), attrs)
        u_attrs = described(units, f"standard uncertainty of the {text}")
        variables[f"u_{name}"] = (dims, spread(found.deviation[..., k], np.nan), dict(u_attrs))
    u_attrs = described("px2", "covariance of the displacements to the right and downwards")
    variables["cov_dx_dy"] = (dims, spread(found.covariance, np.nan), u_attrs)
    plain = {
        "texture": (spread(found.texture, np.nan), "squared slopes of the pattern along its weakest direction"),
        "model": (spread(found.model, 0), "what was solved for beside the motion of the shape"),
        "zncc": (spread(found.zncc, np.nan), "zero-normalised cross-correlation"),
        "contrast": (spread(found.contrast, np.nan), "contrast of the pattern over that of the reference"),
        "iterations": (spread(found.iterations, 0), "evaluations of the subset"),
        "hidden": (spread(found.hidden, np.nan), "share of the subset that something before the specimen hid"),
        "valid": (status == Status.OK, "whether there is a displacement"),
        "status": (status, "status of the displacement"),
    }
    for name, (values, text) in plain.items():
        variables[name] = variable(dims, values, "1", text)
    changes = (
        ("light_slope_x", "px-1", 0, 1.0, "growth of the light to the right"),
        ("light_slope_y", "px-1", 1, 1.0, "growth of the light downwards"),
        ("blur_growth", "px2", 2, 2.0, "growth of the variance of the blur since the reference"),
        ("stretch_x", "1", -2, 1.0, "relative growth of the rows of the subset"),
        ("stretch_y", "1", -1, 1.0, "relative growth of the columns of the subset"),
    )
    for name, units, k, factor, text in changes:
        variables[name] = (dims, spread(factor * found.change[..., k], np.nan), described(units, text))
    variables["model"][2]["flag_masks"] = [LIGHT, BLUR, AFFINE, CURVE]
    variables["model"][2]["flag_meanings"] = "light blur affine curved_light"
    variables["status"][2]["flag_values"] = [int(code) for code in Status]
    variables["status"][2]["flag_meanings"] = " ".join(code.name.lower() for code in Status)
    pixel = {"units": "px"}
    coordinates = {
        "frame": variable("frame", wanted, "1", "frame of the film"),
        "time": variable("frame", time[wanted], "s", "time"),
        "point": variable("point", np.arange(len(places)), "1", "point"),
        "x": ("point", places[:, 0], pixel | {"long_name": "column of the point"}),
        "y": ("point", places[:, 1], pixel | {"long_name": "row of the point"}),
        "subset": ("point", 2 * half + 1, pixel | {"long_name": "width of the subset"}),
    }
    return xr.Dataset(variables, coordinates, {"work": json.dumps(work), "note": note})
