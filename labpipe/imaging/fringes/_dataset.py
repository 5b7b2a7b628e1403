"""Dataset of the contact radii of a film, with its warnings and notes."""

import json
import math
import warnings
from typing import TYPE_CHECKING

import numpy as np

from labpipe.arrays import Floats
from labpipe.frames import FrameSource
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH
from labpipe.imaging.fringes._arguments import FilmOptions
from labpipe.imaging.fringes._edge import corrected_radius
from labpipe.imaging.fringes._film_result import FilmResult
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._ring_fit import Parameter, RingFit
from labpipe.imaging.fringes._ring_model import has_resolved_fringes
from labpipe.imaging.fringes._uncertainty import SOURCES, adhesive_edges, systematic
from labpipe.variables import described, variable

if TYPE_CHECKING:
    import xarray as xr

NONE, FRINGES, EDGE, RESTING, FILLED, OPEN_GAP = range(6)
_METHODS = {
    NONE: "none",
    FRINGES: "fringe_fit",
    EDGE: "edge",
    RESTING: "between_equal_frames",
    FILLED: "wider_than_frame",
    OPEN_GAP: "fringe_fit_open_gap",
}

_TEXTS = {
    "radius": ("m", "Hertz-equivalent contact radius"),
    "u_radius": ("m", "standard uncertainty of the contact radius from noise, misfit and motion"),
    "radius_systematic": ("m", "standard uncertainty of the contact radius shared by all frames"),
    "radius_bound": ("m", "radius that a contact does not exceed where the sphere touches or hovers"),
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
    "semi_axis_major": ("m", "major semi-axis of the contact"),
    "semi_axis_minor": ("m", "minor semi-axis of the contact"),
    "axis_angle": ("rad", "direction of the major axis, from x towards y"),
}


def make_dataset(
    film: FrameSource, options: FilmOptions, result: FilmResult, uncertainties: dict[str, float]
) -> "xr.Dataset":
    """Assemble the Dataset over frame from the contacts of a film.

    ``uncertainties`` are those of pixel size, sphere radius, wavelength, phase and work of adhesion.
    """
    import xarray as xr

    count, pixel = len(film), options.pixel_size
    values = {name: np.full(count, np.nan) for name in _TEXTS}
    parts = np.full((count, len(SOURCES)), np.nan)
    method = np.zeros(count, np.int8)
    for index, fit in result.fits.items():
        method[index] = OPEN_GAP if has_free_gap(fit) else FRINGES
        _put_fit(values, index, fit, result, pixel)
        parts[index] = systematic(fit, result, options, uncertainties)
    for index, edge in result.edges.items():
        method[index] = EDGE
        radius, deviation = corrected_radius(edge, result.view.optics)
        values["radius"][index], values["u_radius"][index] = radius * pixel, deviation * pixel
        values["centre_x"][index], values["centre_y"][index] = edge.x, edge.y
        values["u_centre_x"][index] = values["u_centre_y"][index] = edge.scatter * math.sqrt(2.0 / edge.points)
        # only the pixel size counts in addition to the uncertainty of the estimate
        parts[index] = np.where(np.array(SOURCES) == "pixel_size", radius * uncertainties["pixel_size"], 0.0)
    for index, bound in result.undecided.items():
        values["radius_bound"][index] = max(bound, result.view.least_radius) * pixel
    adhesive_edges(values, parts, method == EDGE, options, uncertainties["work_of_adhesion"])
    values["radius_systematic"] = np.sqrt((parts**2).sum(axis=1))
    method[result.resting] = RESTING
    method[list(result.filled)] = FILLED
    known, resting = np.isin(method, (FRINGES, EDGE, OPEN_GAP)), method == RESTING
    if known.any():
        for line in (*values.values(), *parts.T):  # frames at rest that were not read
            line[resting] = np.interp(film.time[resting], film.time[known], line[known])
    else:
        method[resting] = NONE
    for text in _warnings(options, result):
        warnings.warn(text, UserWarning, stacklevel=3)
    data = {name: variable("frame", values[name], *text) for name, text in _TEXTS.items()}
    flags = {"flag_values": list(_METHODS), "flag_meanings": " ".join(_METHODS.values())}
    data["method"] = ("frame", method, {**described("1", "method of the radius"), **flags})
    data["in_contact"] = variable("frame", method != NONE, "1", "whether there is a contact")
    valid = np.ones(count, bool)
    valid[list(result.damaged)] = False
    data["valid"] = variable("frame", valid, "1", "whether the frame was usable")
    text = "part of the systematic uncertainty of the contact radius"
    data["systematic_part"] = variable(("frame", "source"), parts, "m", text)
    coordinates = {
        "frame": variable("frame", np.arange(count), "1", "frame of the film"),
        "time": variable("frame", film.time, "s", "time"),
        "source": ("source", list(SOURCES), {"long_name": "source of systematic uncertainty"}),
    }
    return xr.Dataset(data, coordinates, _attributes(options, result, uncertainties))


def _put_fit(values: dict[str, Floats], index: int, fit: RingFit, result: FilmResult, pixel: float) -> None:
    """Enter one fit."""
    stretch, shear = fit.value(Parameter.STRETCH), fit.value(Parameter.SHEAR)
    unequal = math.hypot(stretch, shear)
    radius = fit.radius * pixel
    values["radius"][index] = radius / math.sqrt(1.0 - unequal**2)
    own = fit.deviation(Parameter.RADIUS), fit.model_deviation
    values["u_radius"][index] = pixel * math.hypot(*own, result.motion.get(index, 0.0))
    values["semi_axis_major"][index] = radius / (1.0 - unequal)
    values["semi_axis_minor"][index] = radius / (1.0 + unequal)
    # Lengths along this direction are shortened least.
    angle = 0.5 * math.atan2(shear, stretch) + 0.5 * math.pi if unequal else 0.0
    values["axis_angle"][index] = (angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    for name, parameter in (("centre_x", Parameter.X), ("centre_y", Parameter.Y)):
        values[name][index] = fit.value(parameter)
        values[f"u_{name}"][index] = fit.deviation(parameter)
    values["travel"][index] = fit.travel * pixel
    values["misfit"][index] = fit.misfit
    values["residual_ratio"][index] = fit.residual / max(fit.noise, 1e-12)
    values["gap_factor"][index] = math.exp(fit.value(Parameter.SCALE))
    values["visibility"][index] = fit.visibility(result.view.black)


def _warnings(options: FilmOptions, result: FilmResult) -> list[str]:
    """Sentences that a reader of the results must know."""
    texts, view, found = [], result.view, result.calibration
    spots = sum(bool(blank.edges) for blank in result.blanks.values())
    scale = math.expm1(found.changes.get(Parameter.SCALE, 0.0))
    least = view.settings.least_spacing
    fine = any(not has_resolved_fringes(edge.half_radius, view.optics, least) for edge in result.edges.values())
    if result.damaged:
        texts.append(f"{len(result.damaged)} damaged frames were left out")
    if options.wavelength is None:
        texts.append(
            "no wavelength is given: the contact radius is measured from the edge of the spot, to some µm; give "
            "the wavelength of a monochromatic light to use the fringes"
        )
    elif fine or not result.has_fringes:
        texts.append(
            "fringes next to the contact are finer than two pixels: the contact radius is then measured by the edge of "
            "the spot; a higher magnification would resolve them"
        )
    elif result.edges:
        frames, seen = sorted(result.edges), len(result.edges) + len(result.fits)
        named = ", ".join(str(index) for index in frames[:5]) + (", …" if len(frames) > 5 else "")
        texts.append(
            f"frames measured by the edge of the spot, to some µm: {named}, {len(frames)} of {seen} in contact; no "
            "fringes explain them: check wavelength, sphere_radius, pixel_size, phase, focus and covered rings"
        )
    if spots and not (result.fits or result.edges or result.undecided):
        texts.append(
            f"discs in {spots} of the frames have no fringes and neither grow nor shrink as contacts do, and count as "
            "none; check wavelength, sphere_radius, pixel_size and focus, or state any_disc if each is a contact"
        )
    if abs(scale) > 0.003:
        texts.append(
            f"the fringes are {'narrower' if scale > 0 else 'wider'} than R, wavelength and pixel say, as if R times "
            f"wavelength were {-100 * scale / (1 + scale):+.2f} % off; the scale of the fringes was used: check "
            "sphere_radius, wavelength and pixel_size"
        )
    if view.optics.flat > 0.0:
        size = view.optics.flat * options.pixel_size * 1e6
        texts.append(
            f"the gap around the contacts is that of a sphere with a flat of {size:.0f} µm radius, as if worn; the "
            "contact radius allows for it: turn or replace the sphere"
        )
    if math.isfinite(found.doubted_phase):
        texts.append(
            f"the fringes show a phase of {found.doubted_phase:.3f} rad in the contact, not the given "
            f"{options.phase:.3f} rad, which was kept; leave phase out to use what the film shows"
        )
    return texts


def _attributes(options: FilmOptions, result: FilmResult, uncertainties: dict[str, float]) -> dict[str, object]:
    """Attributes of the Dataset."""
    sign = [fit.value(Parameter.MODULATION) for fit in result.fits.values()]
    optics, ratio = result.view.optics, math.exp(result.calibration.changes.get(Parameter.SCALE, 0.0))
    phase = optics.phase - math.pi if sign and float(np.median(sign)) < 0.0 else optics.phase
    least = result.view.least_radius * options.pixel_size
    if options.wavelength is None:
        note = "wavelength not given: edge of the spot only, for a nominal wavelength"
    elif not result.has_fringes:
        note = "fringes not resolved: edge of the spot only"
    elif not (result.fits or result.edges or result.filled):
        note = f"no contact found; a radius below {1e6 * least:.2g} µm cannot be distinguished from a touch"
    else:
        note = f"fringes fitted in {len(result.fits)} of the frames looked at"
    if result.undecided:
        frames = "frame" if len(result.undecided) == 1 else "frames"
        note += f"; in {len(result.undecided)} {frames} the sphere touches or hovers, which counts as no contact"
    return {
        "phase": phase if result.has_fringes else math.nan,
        "u_phase": result.calibration.u.get(Parameter.PHASE, 0.0),
        "phase_scale_ratio": ratio,
        "u_phase_scale_ratio": ratio * result.calibration.u.get(Parameter.SCALE, 0.0),
        "flat_radius": optics.flat * options.pixel_size,
        "blur": optics.blur,
        "least_radius": least,
        "wavelength_used": options.wavelength or NOMINAL_WAVELENGTH,
        "note": f"{note}; {result.note}" if result.note else note,
        "uncertainties": json.dumps(uncertainties),
        "work": json.dumps(result.work),
    }
