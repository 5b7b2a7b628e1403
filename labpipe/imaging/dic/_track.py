"""Digital image correlation: displacement of points of a film to a few thousandths of a pixel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labpipe.arrays import Floats
from labpipe.frames import FrameSource, as_frames
from labpipe.imaging.dic._inputs import check_points, check_seeds, check_settings, masks_of, reach_of, selected_frames

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.imaging.dic._film_window import FilmWindow, Loaded
    from labpipe.imaging.dic._reference import Reference
    from labpipe.imaging.dic._table import Table
    from labpipe.imaging.dic._tracker import Tracker

Shape = Literal["auto", "rigid", "affine"]

#: Correlation below which a point counts as lost: far above a chance match of a usual subset,
#: low enough for grainy films (noise as strong as 0.8 times the pattern).
DEFAULT_MIN_ZNCC = 0.6
DEFAULT_TOLERANCE = 5e-5
DEFAULT_BLUR = 0.5
DEFAULT_ITERATIONS = 30
#: Times that a film is gone through at most, because something was found to stand before the specimen.
_PASSES = 3
#: Growth of what is known to stand before the specimen that is worth another time.
_WORTH = 0.2


def track(
    frames: FrameSource | NDArray[np.generic],
    points: ArrayLike,
    subset: int | Sequence[int] = 31,
    shape: Shape | Sequence[Shape] = "auto",
    order: Literal[5, 3] = 5,
    static_frames: int = 1,
    *,
    select: slice | Sequence[int] | NDArray[np.integer] | None = None,
    seeds: ArrayLike | None = None,
    blur: float = DEFAULT_BLUR,
    min_zncc: float = DEFAULT_MIN_ZNCC,
    tolerance: float = DEFAULT_TOLERANCE,
    max_iterations: int = DEFAULT_ITERATIONS,
    adapt: bool = True,
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
        What a subset may do: shift and turn ("rigid"), or also stretch and shear ("affine"). By
        default it is rigid, and affine in the frames in which the residual shows a stretch. A rigid
        subset on a stiff body has the least noise; a large one averages over the body.
    order : 5 or 3
        Quintic or cubic spline interpolation. Cubic takes half the time and has five times the
        interpolation bias (about 0.001 px on speckles of usual size).
    static_frames : int
        Frames at the start of the film in which nothing moves. Their mean is the reference;
        64 of them lower the noise by 29 % against one. From two on they tell the noise of a pixel,
        by which a wrong place along an edge or a grating of faint grain is recognised.
    select : slice or increasing indices, optional
        Frames wanted; all by default. Others are not read, apart from the static ones.
    seeds : array (point, 2) [px], optional
        Displacement to start from in the first frame after the static ones.
    blur : float [px]
        Gaussian blur of reference and frames; 0 for none. The default lowers bias on fine speckle
        and the effect of grain; 1.0 is better for images drowned in noise.
    min_zncc : float [1]
        Correlation below which a point is lost.
    tolerance : float [px]
        Error that may be left when the iteration stops.
    max_iterations : int
        Evaluations of a subset per frame.
    adapt : bool
        Solve for light that slopes or curves across a subset and for a change of blur (focus, motion
        within the exposure) where the residual shows them. They cost nothing where they are not needed.
    regions : list of arrays (corner, 2) [px], optional
        Polygons in the first frame within which pixels count: the specimen without what is around
        it. A subset partly outside uses what is left of it. What lies within the reach of blur and
        interpolation of their border, 3 px, does not count. Polygons move with the subsets.
    covers : list of arrays (corner, 2) [px], optional
        Polygons in the first frame within which no pixel counts: a screw, a rim. They move with the
        subsets.
    obstructions : list of arrays (corner, 2) [px], optional
        Polygons that stand still in the picture, around what hides the specimen behind it: a rod, a
        needle, a scale bar. Whatever of a subset is behind them in a frame does not count in it.

    Returns
    -------
    Dataset over (frame, point)
        ``dx``, ``dy`` : displacement relative to the mean of the static frames [px];
        ``u_dx``, ``u_dy`` : their standard uncertainty from noise and, where edges are sharper than
        the pixels, from interpolation (lens and out-of-plane motion are not in it) [px];
        ``rotation``, ``u_rotation`` : turn from x towards y, clockwise on the screen [rad];
        ``cov_dx_dy`` : covariance of dx and dy [px²];
        ``texture`` : squared slopes of the pattern, noise taken off, summed over the subset along
        the direction in which they are smallest [grey²/px²];
        ``model`` : what was solved for beside the motion (``flag_meanings``), and what was found:
        ``light_slope_x``, ``light_slope_y`` : growth of the light [1/px], ``blur_growth`` : growth of
        the variance of the blur [px²], to first order; ``stretch_x``, ``stretch_y`` : relative growth of
        what were rows and columns of the subset [1]; all 0 where they were not solved for;
        ``zncc`` : zero-normalised cross-correlation [1]; ``contrast`` of the pattern over that of
        the reference [1];
        ``iterations`` : evaluations of the subset;
        ``hidden`` : share of the subset that something which stands before the specimen hid [1];
        ``valid``, ``status`` : whether there is a value, and if not why (``flag_meanings``).
        Values that are not valid are NaN. Coordinates ``frame`` (index in the film), ``time``
        (s), ``x``, ``y``, ``subset``. The attribute ``work`` counts what was done, ``note`` says what
        was found of the camera: stuck pixels, which are interpolated, rows of two instants, something that stands
        still before the specimen though no obstruction says so, which is left out, and strain that rigid points miss.
        ``standing``, where something does: its first and last column, first and last row [px].

    Raises
    ------
    InputError
        A parameter out of its range, an empty film, images that are not grey, a film whose static
        frames are all damaged, or a polygon that no pixel lies in.

    Warns
    -----
    UserWarning
        The static frames are not static; the film is interlaced, or its rows repeat each other: such
        frames have no results.

    Notes
    -----
    Zero-normalised least squares by inverse-compositional Gauss–Newton iteration on exact
    B-spline interpolation. Each point starts where constant velocity leads it; a point that
    jumped or whose correlation fell is confirmed by its neighbours or found again by template
    matching. The uncertainty follows from the inverse normal matrix and the residual; it was
    found within 10 % of the scatter.

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
    from labpipe.imaging.dic._attempt import Options
    from labpipe.imaging.dic._film_window import FilmWindow
    from labpipe.imaging.dic._interlaced import refuse_rows
    from labpipe.imaging.dic._lagging import held_back
    from labpipe.imaging.dic._missed_strain import told_of as told_of_strain
    from labpipe.imaging.dic._reference import make_reference
    from labpipe.imaging.dic._results import displacements, make_dataset
    from labpipe.imaging.dic._standing import Standing, standing_told, unstated_box
    from labpipe.imaging.dic._subsets import adaptable
    from labpipe.imaging.dic._tracker import Tracker
    from labpipe.imaging.films import without_stuck_pixels

    film = as_frames(frames)
    places, half, shapes = check_points(points, subset, shape)
    check_settings(film, order, static_frames, blur, tolerance, max_iterations, min_zncc)
    wanted = selected_frames(select, len(film))
    indices = np.union1d(np.arange(static_frames), wanted)
    film, stuck = without_stuck_pixels(film, np.isin(np.arange(len(film)), indices))
    inside, hidden = masks_of(regions, covers, obstructions, film.shape, blur)
    window = FilmWindow(film, order, blur)
    start = check_seeds(seeds, len(places))
    done, stated = [], hidden
    while True:
        reference = make_reference(film, places, half, shapes != "affine", order, static_frames, blur, inside)
        standing = None if hidden is None else Standing(hidden)
        options = Options(order, tolerance, max_iterations, min_zncc, adaptable(shapes, adapt), standing)
        window.frames_read += static_frames
        window.pixels_read += static_frames * film.shape[1] * film.shape[2]
        tracker = Tracker(reference, window, options)
        table = _follow(film, window, tracker, reference, indices, static_frames, start)
        done.append(tracker.solver.work)
        # what was found to stand before the specimen is left out from the first frame on
        behind = held_back(tracker, table, indices, indices < static_frames)
        more = tracker.votes.hidden(reach_of(blur)) | behind.hidden(reach_of(blur))
        more &= True if hidden is None else ~hidden
        known = 0 if hidden is None else int(hidden.sum())
        if len(done) == _PASSES or not more.any() or more.sum() < _WORTH * known:
            break
        hidden = more if hidden is None else hidden | more
        inside = np.asarray(~more if inside is None else inside * ~more, np.float32)
    work = {
        "frames_read": window.frames_read + stuck.frames_read,
        "frames_total": len(film),
        "pixels_read": window.pixels_read + stuck.frames_read * film.shape[1] * film.shape[2],
        "pixels_total": int(np.prod(film.shape)),
        "subsets_solved": sum(work.subsets_solved for work in done),
        "iterations": sum(work.iterations for work in done),
        "reseeds": sum(work.reseeds for work in done),
    }
    is_static = indices < static_frames
    found = displacements(table, reference, is_static)
    box = [] if stated is hidden else unstated_box(hidden, stated, reach_of(blur))
    rows = refuse_rows(found, window.rows, indices, is_static, film)
    strained = told_of_strain(found.missed, found.deviation, shapes[reference.usable] == "rigid")
    stands = standing_told(box, is_beside_stated=stated is not None) if box else ""
    note = "; ".join(filter(None, (stuck.note, rows, stands, strained)))
    result = make_dataset(film.time, places, half, indices, wanted, found, reference, work, note)
    return result.assign_attrs(standing=box, standing_told=stands) if box else result


def _follow(
    film: FrameSource,
    window: FilmWindow,
    tracker: Tracker,
    reference: Reference,
    indices: NDArray[np.int64],
    static_frames: int,
    start: Floats | None,
) -> Table:
    """Go through the frames once; the next is read and filtered while this one is solved."""
    from labpipe.imaging.dic._recovery import follow
    from labpipe.imaging.dic._standing import packed
    from labpipe.imaging.dic._table import empty_table

    table = empty_table(len(indices), len(reference.usable))
    if not len(reference.usable):
        return table
    rows = np.flatnonzero(np.asarray(film.valid, bool)[indices])
    for row, loaded in _read_ahead(window, tracker, indices, rows):
        index = int(indices[row])
        if start is not None and index >= static_frames:
            tracker.start_from(start[reference.usable])
            start = None
        if loaded.coefficients is None:
            continue
        tracker.solver.is_static = index < static_frames
        found = follow(tracker, index, loaded)
        table.motion[row] = found.motion
        table.gain[row] = found.gain
        table.residual[row] = found.residual
        table.zncc[row] = found.zncc
        table.iterations[row] = found.iterations
        table.model[row] = found.model
        table.change[row] = found.change
        table.growth[row] = tracker.solver.growth
        table.spread[row] = tracker.solver.misfit_spread(loaded, found)
        table.status[row] = found.status
        table.left.update({(row, n): packed(left) for n, left in tracker.left(found).items()})
    return table


def _read_ahead(
    window: FilmWindow, tracker: Tracker, indices: NDArray[np.int64], rows: NDArray[np.int64]
) -> Iterator[tuple[int, Loaded]]:
    """Yield the loaded rectangle of every frame, one frame ahead of the solver."""
    if not len(rows):
        return
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="film") as reader:
        first = int(indices[rows[0]])
        pending = reader.submit(window.load, first, tracker.box(first), tracker.pieces(first))
        for k, row in enumerate(rows):
            loaded = pending.result()
            index = int(indices[row])
            if not tracker.covers(loaded, index):
                loaded = reader.submit(window.load, index, tracker.box(index), tracker.pieces(index)).result()
            if k + 1 < len(rows):
                following = int(indices[rows[k + 1]])
                pending = reader.submit(window.load, following, tracker.box(following), tracker.pieces(following))
            yield int(row), loaded
