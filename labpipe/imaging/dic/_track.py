"""Digital image correlation: displacement of points of a film to a few thousandths of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labpipe.frames import FrameSource, as_frames
from labpipe.imaging.dic._arguments import check_points, check_settings, selected_frames

if TYPE_CHECKING:
    import xarray as xr

Shape = Literal["auto", "rigid", "affine"]


def track(
    frames: FrameSource | NDArray[np.generic],
    points: ArrayLike,
    subset: int | Sequence[int] = 31,
    shape: Shape | Sequence[Shape] = "auto",
    order: Literal[5, 3] = 5,
    static_frames: int = 1,
    *,
    select: slice | Sequence[int] | NDArray[np.integer] | None = None,
    blur: float = 0.5,
    min_zncc: float = 0.6,
    regions: Sequence[ArrayLike] | None = None,
    covers: Sequence[ArrayLike] | None = None,
    obstructions: Sequence[ArrayLike] | None = None,
) -> xr.Dataset:
    """Follow points through a film by digital image correlation.

    Parameters
    ----------
    frames : FrameSource or array (frame, row, column)
        Grey images. One frame is in memory at a time.
    points : array (point, 2) [px]
        Points (x, y) in the first frame; x to the right, y down, (0, 0) the centre of the first
        pixel.
    subset : odd int, or one per point [px]
        Width of the square around each point that is matched, 9 or more.
    shape : "auto", "rigid" or "affine", or one per point
        Motion of a subset: shift and turn ("rigid"), or also stretch and shear ("affine"). By
        default it is rigid, and affine in the frames in which the residual shows a stretch. A rigid
        subset on a stiff body has the least noise; a large one averages over the body.
    order : 5 or 3
        Quintic or cubic spline interpolation. Cubic has five times the interpolation bias (about 0.001 px on
        speckles of usual size) and takes about as long.
    static_frames : int
        Frames at the start of the film in which nothing moves. Their mean is the reference;
        64 of them lower the noise by 29 % against one.
    select : slice or increasing indices, optional
        Frames wanted; all by default. Others are not read, apart from the static ones.
    blur : float [px]
        Gaussian blur of reference and frames; 0 for none. The default lowers bias on fine speckle
        and the effect of grain; 1.0 is better for images drowned in noise.
    min_zncc : float [1]
        Correlation below which a point is lost. The default is far above a chance match of a usual subset, and low
        enough for noise as strong as 0.8 times the pattern.
    regions : list of arrays (corner, 2) [px], optional
        Polygons in the first frame within which pixels count: the specimen without its
        surroundings. A subset partly outside uses the part inside. Pixels within the reach of blur and
        interpolation of their border, 3 px, do not count. Polygons move with the subsets.
    covers : list of arrays (corner, 2) [px], optional
        Polygons in the first frame within which no pixel counts: a screw, a rim. They move with the
        subsets.
    obstructions : list of arrays (corner, 2) [px], optional
        Polygons that stand still in the picture, around objects in front of the specimen: a rod, a
        needle, a scale bar. The part of a subset behind them in a frame does not count in it.

    Returns
    -------
    Dataset over (frame, point)
        ``dx``, ``dy`` : displacement relative to the mean of the static frames [px];
        ``u_dx``, ``u_dy`` : their standard uncertainty from noise and from the residual (lens and out-of-plane
        motion are not in it) [px];
        ``rotation``, ``u_rotation`` : turn from x towards y, clockwise on the screen [rad];
        ``cov_dx_dy`` : covariance of dx and dy [px²];
        ``stretch_x``, ``stretch_y`` : relative growth of the rows and the columns of the subset [1], 0 of a rigid one;
        ``zncc`` : zero-normalised cross-correlation [1]; ``contrast`` of the pattern over that of
        the reference [1];
        ``iterations`` : evaluations of the subset;
        ``hidden`` : share of the subset behind stated obstructions [1];
        ``valid``, ``status`` : there is a value, and if not why (``flag_meanings``).
        Values that are not valid are NaN. Coordinates ``frame`` (index in the film), ``time``
        (s), ``x``, ``y``, ``subset``. The attribute ``work`` counts the work; ``note`` says how many hot pixels
        were interpolated.

    Raises
    ------
    InputError
        A parameter out of its range, an empty film, images that are not grey, a film whose static
        frames are all damaged, or a polygon that no pixel lies in.

    Warns
    -----
    UserWarning
        The static frames are not static.

    Notes
    -----
    Zero-normalised least squares by inverse-compositional Gauss–Newton iteration on exact
    B-spline interpolation. Each point starts where constant velocity leads it; a point that
    jumped or whose correlation fell is confirmed by its neighbours or found again by template
    matching. The uncertainty follows from the inverse normal matrix and the noise that the residual shows; a residual
    that is correlated (aliasing, compression) widens it.

    Nothing is repaired. A point is refused, with its reason in ``status``, that has too little texture along its
    weakest direction (edges), a pattern that repeats itself, too many pixels at black or white, another place than its
    neighbours, no supporting neighbour after a jump, or something in front of it that nobody stated.

    References
    ----------
    B. Pan, K. Li, W. Tong, Exp. Mech. 53 (2013) 1277-1289,
    https://doi.org/10.1007/s11340-013-9717-6

    Examples
    --------
    >>> y, x = np.mgrid[:64, :64]
    >>> pattern = lambda dx: 100 + 50 * np.sin(0.7 * (x - dx)) * np.cos(0.5 * y)
    >>> film = np.stack([pattern(0.0), pattern(0.25)])
    >>> found = track(film, [(32, 32)], subset=21)
    >>> float(found.dx[1, 0].round(3))
    0.25
    """
    from labpipe.imaging.dic._film_window import FilmWindow
    from labpipe.imaging.dic._occlusion import masks_of
    from labpipe.imaging.dic._reference import make_reference
    from labpipe.imaging.dic._reseeding import follow
    from labpipe.imaging.dic._results import Table, make_dataset
    from labpipe.imaging.dic._tracker import Tracker
    from labpipe.imaging.films import without_stuck_pixels

    film = as_frames(frames)
    places, half, shapes = check_points(points, subset, shape)
    check_settings(film, order, static_frames, blur, min_zncc)
    wanted = selected_frames(select, len(film))
    indices = np.union1d(np.arange(static_frames), wanted)
    film, hot = without_stuck_pixels(film, np.isin(np.arange(len(film)), indices))
    inside, obstructed = masks_of(regions, covers, obstructions, film.shape, blur)
    reference = make_reference(film, places, half, shapes, order, static_frames, blur, inside)
    window = FilmWindow(film, order, blur)
    window.frames_read = static_frames + hot.frames_read
    window.pixels_read = window.frames_read * film.shape[1] * film.shape[2]
    tracker = Tracker(reference, window, order, min_zncc, obstructed)
    table = Table.empty(len(indices), len(reference.usable))
    rows = np.flatnonzero(np.asarray(film.valid, bool)[indices]) if len(reference.usable) else indices[:0]
    for row in rows:
        index = int(indices[row])
        tracker.is_static = index < static_frames
        expected = tracker.predict(index)
        loaded = window.load(index, tracker.box(expected))
        if loaded.coefficients is not None:
            table.fill(row, follow(tracker, index, loaded, expected), reference, min_zncc)
    work = {
        "frames_read": window.frames_read,
        "frames_total": len(film),
        "pixels_read": window.pixels_read,
        "pixels_total": int(np.prod(film.shape)),
        "subsets_solved": tracker.subsets_solved,
        "iterations": tracker.iterations,
        "reseeds": tracker.reseeds,
    }
    attrs: dict[str, object] = {"work": work, "note": hot.note}
    return make_dataset(table, reference, film.time, places, half, indices, wanted, indices < static_frames, attrs)
