"""Assemble the fits of a film into the Dataset of contact radii."""

import json
import math
import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.frames import FrameSource
from labpipe.imaging.fringes._acceptance import visibility_of
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH, edge_shift
from labpipe.imaging.fringes._arguments import FilmOptions
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._edge import corrected_radius
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._radial_scan import edge_width, has_resolved_fringes
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.variables import described, variable

if TYPE_CHECKING:
    import xarray as xr


NONE, FRINGES, EDGE, RESTING, FILLED, OPEN_GAP = 0, 1, 2, 3, 4, 5
_METHODS = {
    NONE: "none",
    FRINGES: "fringe_fit",
    EDGE: "edge",
    RESTING: "between_equal_frames",
    FILLED: "wider_than_frame",
    OPEN_GAP: "fringe_fit_open_gap",
}
#: Sources of the systematic budget, in the order of the coordinate.
SOURCES = ("sphere_radius", "wavelength", "pixel_size", "phase", "optics", "adhesion")
#: Deviation of the fringes' scale from R, wavelength and pixel size that is worth a warning.
_NOTABLE_SCALE = 0.003
#: Difference of the radii in the middle of an exposure in which a², as is assumed, or a itself changes evenly, over
#: the square of the travel divided by the radius: where rings only blur, and where the travel is wider than they are.
_EVEN_RADIUS, _EVEN_FAR = 1.0 / 24.0, 1.0 / 8.0
#: Full width of a Gaussian at half its height, in standard deviations; share of the wavelength from which the width
#: of a band of colours is told.
BELL_WIDTH, _NOTABLE_WIDTH = 2.0 * math.sqrt(2.0 * math.log(2.0)), 0.02
#: Rest: change of the radius, relative to its end, and fewest frames.
_REST_CHANGE, _LEAST_REST = 0.01, 5
#: Frames that a warning names.
_NAMED = 5

_TEXTS = {
    "radius": ("m", "Hertz-equivalent contact radius"),
    "u_radius": ("m", "standard uncertainty of the contact radius from noise and misfit"),
    "radius_systematic": ("m", "standard uncertainty of the contact radius shared by all frames"),
    "edge_radius": ("m", "radius of the edge of the contact, with adhesion"),
    "u_edge_radius": ("m", "standard uncertainty of the radius of the edge, with what all frames share"),
    "centre_x": ("px", "column of the centre of the contact"),
    "u_centre_x": ("px", "standard uncertainty of the column of the centre"),
    "centre_y": ("px", "row of the centre of the contact"),
    "u_centre_y": ("px", "standard uncertainty of the row of the centre"),
    "travel": ("m", "change of the contact radius during the exposure, without sign"),
    "misfit": ("1", "residual beyond noise as a share of the modulation"),
    "residual_ratio": ("1", "residual divided by noise"),
    "visibility": ("1", "visibility of the fringes"),
    "gap_factor": ("1", "factor by which the gap beside the contact exceeds Hertz's"),
    "own_scale": ("1", "phase scale of the fringes by this frame alone over that of the film"),
    "u_own_scale": ("1", "standard uncertainty of the phase scale by this frame alone"),
    "semi_axis_major": ("m", "major semi-axis of the contact"),
    "semi_axis_minor": ("m", "minor semi-axis of the contact"),
    "axis_angle": ("rad", "direction of the major axis, from x towards y"),
}


def make_dataset(
    film: FrameSource, options: FilmOptions, result: FilmResult, uncertainties: dict[str, float]
) -> "xr.Dataset":
    """Assemble the Dataset over frame.

    Parameters
    ----------
    film : FrameSource
        The film.
    options : FilmOptions
        How it was measured.
    result : FilmResult
        What was found.
    uncertainties : dict
        Standard uncertainties of pixel size, sphere radius, wavelength and phase.
    """
    import xarray as xr

    count = len(film)
    values = {name: np.full(count, np.nan) for name in _TEXTS}
    parts = np.full((count, len(SOURCES)), np.nan)
    method = np.zeros(count, np.int8)
    for index, fit in result.fits.items():
        method[index] = OPEN_GAP if has_free_gap(fit) else FRINGES
        _put_fit(values, index, fit, result, options.pixel_size)
        parts[index] = _systematic(fit, result, options, uncertainties)
    for index, edge in result.edges.items():
        method[index] = EDGE
        radius, deviation = corrected_radius(edge, result.view.optics)
        values["radius"][index] = radius * options.pixel_size
        values["u_radius"][index] = deviation * options.pixel_size
        values["centre_x"][index], values["centre_y"][index] = edge.x, edge.y
        noise = edge.scatter * math.sqrt(2.0 / edge.points)
        values["u_centre_x"][index] = values["u_centre_y"][index] = noise
        parts[index] = _edge_systematic(radius, result, options, uncertainties)
    _put_edges(values, parts, method, options, uncertainties["work_of_adhesion"])
    values["radius_systematic"] = np.sqrt((parts**2).sum(axis=1))
    method[result.resting] = RESTING
    method[list(result.filled)] = FILLED
    _interpolate(values, parts, method, film.time)
    for index, (log_scale, u) in result.scales.items():
        values["own_scale"][index] = math.exp(log_scale)
        values["u_own_scale"][index] = math.exp(log_scale) * u
    _warn(options, result)
    static, u_static = _static_radius(values["radius"], values["u_radius"], method)
    data: dict[str, tuple[object, ...]] = {
        name: variable("frame", values[name], units, text) for name, (units, text) in _TEXTS.items()
    }
    flags = described("1", "method of the radius")
    data["method"] = (
        "frame",
        method,
        {**flags, "flag_values": list(_METHODS), "flag_meanings": " ".join(_METHODS.values())},
    )
    data["in_contact"] = variable("frame", method != NONE, "1", "whether there is a contact")
    valid = np.ones(count, bool)
    valid[list(result.damaged)] = False
    data["valid"] = variable("frame", valid, "1", "whether the frame was usable")
    data["systematic_part"] = variable(
        ("frame", "source"), parts, "m", "part of the systematic uncertainty of the contact radius"
    )
    rest = "mean contact radius at rest at the end of the film"
    data["static_radius"] = variable((), static, "m", rest)
    data["u_static_radius"] = variable((), u_static, "m", f"standard uncertainty of the {rest}")
    coordinates = {
        "frame": variable("frame", np.arange(count), "1", "frame of the film"),
        "time": variable("frame", film.time, "s", "time"),
        "source": ("source", list(SOURCES), {"long_name": "source of systematic uncertainty"}),
    }
    return xr.Dataset(data, coordinates, _attributes(options, result, uncertainties))


def _put_fit(values: dict[str, Floats], index: int, fit: RingFit, result: FilmResult, pixel: float) -> None:
    """Enter one fit."""
    p = fit.parameters
    stretch, shear = float(p[Parameter.STRETCH]), float(p[Parameter.SHEAR])
    unequal = math.hypot(stretch, shear)
    radius = float(p[Parameter.RADIUS]) * pixel
    values["radius"][index] = radius / math.sqrt(1.0 - unequal**2)
    deviation = math.hypot(fit.deviation(Parameter.RADIUS), fit.model_deviation, _by_motion(fit, result))
    values["u_radius"][index] = deviation * pixel
    values["semi_axis_major"][index] = radius / (1.0 - unequal)
    values["semi_axis_minor"][index] = radius / (1.0 + unequal)
    # Lengths along this direction are shortened least.
    angle = 0.5 * math.atan2(shear, stretch) + 0.5 * math.pi if unequal else 0.0
    values["axis_angle"][index] = (angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    for name, parameter in (("centre_x", Parameter.X), ("centre_y", Parameter.Y)):
        values[name][index] = p[parameter]
        values[f"u_{name}"][index] = fit.deviation(parameter)
    values["travel"][index] = math.sqrt(max(float(p[Parameter.SMEAR]), 0.0)) * pixel
    values["misfit"][index] = fit.misfit
    values["residual_ratio"][index] = fit.residual / max(fit.noise, 1e-12)
    values["gap_factor"][index] = math.exp(float(p[Parameter.SCALE]))
    values["visibility"][index] = visibility_of(fit, result.view)


def _by_motion(fit: RingFit, result: FilmResult) -> float:
    """Return u of the radius (px) as nothing tells how evenly it changes in the exposure."""
    square, radius = (float(fit.parameters[p]) for p in (Parameter.SMEAR, Parameter.RADIUS))
    if square <= 0.0:
        return 0.0
    far = (square / edge_width(radius, result.view.optics) ** 2) ** 2
    share = _EVEN_RADIUS + (_EVEN_FAR - _EVEN_RADIUS) * far / (1.0 + far)
    return share * square / max(radius, 1.0)


def _put_edges(
    values: dict[str, Floats], parts: Floats, method: NDArray[np.int8], options: FilmOptions, u_work: float
) -> None:
    """Enter the edge of adhesive contacts, and adhesion among what all frames share.

    Without a stated work of adhesion the edge lies anywhere between Hertz's and that of a clean
    smooth polymer.
    """
    seen = np.isfinite(values["radius"]) & (values["radius"] > 0.0)
    if options.reduced_modulus is None or not seen.any():
        return
    radius = values["radius"][seen]
    shift, u = edge_shift(
        radius,
        options.sphere_radius,
        options.reduced_modulus,
        options.work_of_adhesion,
        u_work,
        options.wavelength,
        options.pixel_size,
        method[seen] == EDGE,
    )
    known = np.hypot(values["u_radius"][seen], np.sqrt(np.nansum(parts[seen] ** 2, axis=1)))
    parts[seen, SOURCES.index("adhesion")] = np.hypot(shift, u)
    values["edge_radius"][seen], values["u_edge_radius"][seen] = radius + shift, np.hypot(known, u)


def _systematic(fit: RingFit, result: FilmResult, options: FilmOptions, uncertainties: dict[str, float]) -> Floats:
    """Parts of the systematic uncertainty (m), in the order of :data:`SOURCES`.

    R, wavelength and pixel size change the scale of the phase; pixel size also the length itself.
    """
    pixel = options.pixel_size
    by_scale = fit.sensitivity[Parameter.SCALE] * pixel
    by_phase = fit.sensitivity[Parameter.PHASE] * pixel
    radius = float(fit.parameters[Parameter.RADIUS]) * pixel
    relative = uncertainties["pixel_size"] / pixel
    relative_wavelength = uncertainties["wavelength"] / (options.wavelength or NOMINAL_WAVELENGTH)
    return np.abs(
        [
            by_scale * uncertainties["sphere_radius"] / options.sphere_radius,
            by_scale * math.hypot(relative_wavelength, result.calibration.u_log_scale),
            (radius - 2.0 * by_scale) * relative,
            by_phase * math.hypot(uncertainties["phase"], result.calibration.u_phase_shift),
            result.calibration.shared(float(fit.parameters[Parameter.RADIUS])) * pixel,
            0.0,
        ]
    )


def _edge_systematic(
    radius: float, result: FilmResult, options: FilmOptions, uncertainties: dict[str, float]
) -> Floats:
    """Parts for an edge: only the pixel size counts beside the uncertainty of the estimate."""
    return np.array([0.0, 0.0, radius * uncertainties["pixel_size"], 0.0, 0.0, 0.0])


def _interpolate(values: dict[str, Floats], parts: Floats, method: NDArray[np.int8], time: Floats) -> None:
    """Fill the frames at rest that were not read from those before and after."""
    known = np.flatnonzero(np.isin(method, (FRINGES, EDGE, OPEN_GAP)))
    resting = np.flatnonzero(method == RESTING)
    if not len(known):
        method[resting] = NONE
        return
    for line in (*values.values(), *parts.T):
        line[resting] = np.interp(time[resting], time[known], line[known])


def _static_radius(radius: Floats, deviation: Floats, method: NDArray[np.int8]) -> tuple[float, float]:
    """Mean radius over the last frames that hardly change, and its standard uncertainty."""
    used = np.flatnonzero(np.isfinite(radius))
    if not len(used) or used[-1] < len(radius) - 1:
        return math.nan, math.nan
    end = float(np.median(radius[used[-_LEAST_REST:]]))
    is_still = np.abs(radius - end) < _REST_CHANGE * end  # NaN: not in contact, not still
    moving = np.flatnonzero(~is_still)
    rest = np.arange(moving[-1] + 1 if len(moving) else 0, len(radius))
    if len(rest) < _LEAST_REST:
        return math.nan, math.nan
    weights = 1.0 / np.maximum(deviation[rest], 1e-15) ** 2
    measured = method[rest] != RESTING
    mean = float((weights * radius[rest]).sum() / weights.sum())
    scatter = float(np.std(radius[rest][measured])) if measured.sum() > 1 else 0.0
    count = max(int(measured.sum()), 1)
    return mean, max(scatter, float(np.median(deviation[rest]))) / math.sqrt(count)


def _warn(options: FilmOptions, result: FilmResult) -> None:
    """Tell what a reader of the results must know."""
    texts = []
    rows = _rows_told(result)
    if rows:
        texts.append(rows)
    elif result.damaged:
        texts.append(f"{len(result.damaged)} damaged frames were left out")
    if options.wavelength is None:
        texts.append(
            "no wavelength is given: the contact radius is measured from the edge of the spot, "
            "to a few micrometres; give the wavelength of a monochromatic light to use the fringes"
        )
    elif _fades(result):
        texts.append(
            "the fringes fade as in light of many colours, so that no wavelength explains more than the first of them: "
            "the contact radius is measured from the edge of the spot, to a few micrometres; use a laser or a narrow "
            "filter, or leave wavelength out"
        )
    elif not result.has_fringes or _has_fine_fringes(result):
        texts.append(
            "fringes next to the contact are finer than two pixels: the contact radius is then "
            "measured by the edge of the spot; a higher magnification would resolve them"
        )
    elif result.edges:
        texts.append(
            f"{_frames_by_edge(result)} measured by the edge of the spot, to a few micrometres: no fringes "
            "of a contact explain them; check wavelength, sphere_radius, pixel_size, phase, focus and what hides rings"
        )
    unexplained = _unexplained_told(result)
    if unexplained:
        texts.append(
            f"{unexplained}: check wavelength, sphere_radius, pixel_size and phase, the focus, how far "
            "contacts move in an exposure, and what else interferes or scatters"
        )
    scale = math.expm1(result.log_scale)
    if abs(scale) > _NOTABLE_SCALE:
        texts.append(
            f"the fringes are {'narrower' if scale > 0 else 'wider'} than R, wavelength and pixel "
            f"size say, as if R times wavelength were {-100 * scale / (1 + scale):+.2f} % off; the scale "
            "of the fringes was used: check sphere_radius, wavelength and pixel_size"
        )
    if result.calibration.flat > 0.0:
        size = result.calibration.flat * options.pixel_size * 1e6
        texts.append(
            f"the gap around the contacts is that of a sphere with a flat of {size:.0f} µm radius, as if worn; "
            "the contact radius allows for it: turn or replace the sphere"
        )
    doubted = result.calibration.doubted_phase
    if math.isfinite(doubted):
        texts.append(
            f"the fringes show a phase of {doubted:.3f} rad in the contact, not the given "
            f"{options.phase:.3f} rad, which was kept; leave phase out to use what the film shows"
        )
    for text in texts:
        warnings.warn(text, UserWarning, stacklevel=4)


def _rows_told(result: FilmResult) -> str:
    """Tell what is wrong with the rows of the film; empty when nothing is."""
    if result.repeats_rows:
        return (
            "every second row of the film repeats its neighbour or is the mean of both: it shows one field of an "
            "interlaced recording, whose frames were left out"
        )
    if result.combed:
        return (
            f"odd and even rows of {len(result.combed)} frames show different instants: the film is interlaced, and "
            f"{len(result.damaged)} frames were left out; record progressive frames"
        )
    return ""


def _lost_told(result: FilmResult) -> str:
    """Tell of the rows that repeat others here and there; empty when there are none."""
    if not result.lost_rows or result.repeats_rows:
        return ""
    count, frames = sum(result.lost_rows.values()), len(result.lost_rows)
    return (
        f"{count} rows in {frames} of the frames repeat the row before, as when a transfer loses some, and were "
        "interpolated"
    )


def _colour_told(options: FilmOptions, result: FilmResult) -> str:
    """Tell of a second colour in the light, or a band of them; empty when there is none."""
    ratio, share = result.view.optics.colour
    width = BELL_WIDTH * math.sqrt(result.view.optics.spread)
    if options.wavelength is None:
        return ""
    if not share and width > _NOTABLE_WIDTH:
        spread = f"a band of colours {width * options.wavelength * 1e9:.0f} nm wide at half its height"
        return f"{spread}, or a cone of light that fades rings as much, was allowed for"
    if not share:
        return ""
    colour = f"a second colour near {options.wavelength / ratio * 1e9:.0f} nm"
    return f"{colour}, {100 * share:.0f} % of the fringes, was allowed for"


def _focus_told(options: FilmOptions, result: FilmResult) -> str:
    """Tell of contacts out of focus, and of a camera that sharpens its images; empty when there is neither."""
    distance, (share, width) = abs(result.view.optics.focus) * options.sphere_radius, result.view.optics.halo
    focus = f"contacts {distance * 1e6:.0f} µm out of focus were allowed for" if distance else ""
    sharp = f"the images are sharpened (by {share:.1f} over {width:.1f} px), which was allowed for: turn that off"
    return "; ".join(filter(None, (focus, sharp if share else "")))


def _fits_told(result: FilmResult) -> str:
    """Tell in how many frames fringes were fitted where some of those looked at show no contact."""
    if not result.fits:
        return "no fringes fitted"
    blank = len(result.blanks.keys() - result.fits.keys() - result.edges.keys() - result.filled)
    if not blank:
        return "fringes fitted"
    others = "1 other shows" if blank == 1 else f"{blank} others show"
    return f"fringes fitted in {len(result.fits)} of the frames looked at; {others} no contact"


def _unexplained_told(result: FilmResult) -> str:
    """Tell of spots and patterns that may be contacts where no fringes explain any; empty where there are none."""
    if result.fits or result.filled:
        return ""
    spotted = 0 if result.edges else sum(bool(blank.edges) for blank in result.blanks.values())
    counted = [
        f"{what} {count} frame{'' if count == 1 else 's'} {why}"
        for what, count, why in (
            ("spots in", spotted, "have neither the fringes nor the sharp edge of a contact"),
            ("a pattern that fills", result.patterned, "is neither a contact nor a sphere close by, and may hide one"),
        )
        if count
    ]
    return ", ".join(counted)


def _frames_by_edge(result: FilmResult) -> str:
    """Name the frames that fell back to the edge, with their verb."""
    frames = sorted(result.edges)
    named = ", ".join(str(index) for index in frames[:_NAMED]) + (", …" if len(frames) > _NAMED else "")
    seen = len(frames) + len(result.fits)
    if len(frames) == 1:
        return f"1 of {seen} frames in contact (frame {named}) was"
    return f"{len(frames)} of {seen} frames in contact (frames {named}) were"


def _fades(result: FilmResult) -> bool:
    """Tell whether pixels resolve the fringes, and only the light does not show them."""
    return not result.has_fringes and result.view.templates is not None


def _has_fine_fringes(result: FilmResult) -> bool:
    """Tell whether edges were measured where fringes are too fine for the pixels."""
    optics = result.view.optics
    return any(
        not has_resolved_fringes(edge.half_radius, optics, result.view.settings.least_spacing)
        for edge in result.edges.values()
    )


def _attributes(options: FilmOptions, result: FilmResult, uncertainties: dict[str, float]) -> dict[str, object]:
    """Attributes of the Dataset."""
    sign = [float(fit.parameters[Parameter.MODULATION]) for fit in result.fits.values()]
    phase = result.view.optics.phase
    if sign and float(np.median(sign)) < 0.0:
        phase -= math.pi
    note = _fits_told(result)
    if options.wavelength is None:
        note = "wavelength not given: edge of the spot only, for a nominal wavelength"
    elif _fades(result):
        note = "fringes fade as in white light: edge of the spot only"
    elif not result.has_fringes:
        note = "fringes not resolved: edge of the spot only"
    elif result.edges:
        note += f"; {_frames_by_edge(result)} measured by the edge of the spot"
    least = result.least_radius * options.pixel_size
    if not (result.fits or result.edges or result.filled):
        note = f"no contact found; one of less than {1e6 * least:.2g} µm in radius is not told from a touch"
    rows = _unexplained_told(result), _rows_told(result), _lost_told(result)
    return {
        "phase": phase if result.has_fringes else math.nan,
        "u_phase": result.calibration.u_phase_shift,
        "phase_scale_ratio": math.exp(result.log_scale),
        "flat_radius": result.calibration.flat * options.pixel_size,
        "blur": result.calibration.blur,
        "interlaced": int(result.repeats_rows or bool(result.combed)),
        "least_radius": least,
        "harmonics": list(result.view.harmonics),
        "wavelength_used": options.wavelength or NOMINAL_WAVELENGTH,
        "note": "; ".join(
            filter(
                None,
                (
                    note,
                    _colour_told(options, result),
                    _focus_told(options, result),
                    *rows,
                    result.stuck.note,
                    _reflection_told(result),
                ),
            )
        ),
        "uncertainties": json.dumps(uncertainties),
        "work": json.dumps(result.work),
    }


def _reflection_told(result: FilmResult) -> str:
    """Tell of a reflection that was taken off."""
    where = f"around {result.reflecting} pixels that are clipped in every frame"
    return f"the light of a reflection that stands still taken off {where}" if result.reflecting else ""
