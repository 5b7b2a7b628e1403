"""Camera against laser: the holder's motion from a film, aligned with the laser's mean.

The two were recorded in different sessions; they are aligned at first contact (t_c = 0, and the
height of that contact is 0). Point 0 of the tracks is the large subset on the holder, whose motion
is the result; the others are the line of small subsets of the thesis.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
from calibration import camera as camera_scale
from labpipe import imaging, signals
from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.variables import variable, with_u
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.film_checks import light_of, said_by_file
from pipelines.experiments.shared.film_frames import film_of, key_frames, meanings, recorded_on, thinned

SOLVED = 1e-4
"""Tolerance of places [px] of one image, solved for from other beginnings; noise changes them by more."""
TURNED = "found_turned"
_ACROSS = ("displacement_x", "displacement_y", "u_displacement_x", "u_displacement_y")


@dataclass(frozen=True, slots=True)
class Reading:
    """How a film is read, and which motion is known; px, frames, rad."""

    largest_body: int = 201  # its noise is a thousandth of a pixel, and larger ones cost more
    most_static: int = 64  # in the reference: noise within 1 % of that of endless many
    moving: float = 1.1  # ratio of difference images to noise at which something moves (about 0.05 px)
    margin: float = 0.8  # of the frames found still that are used
    every: int = 8  # the coarse pass, and what is read after rest
    at_rest: float = 0.05  # from the last level, within which the holder is at rest
    after_rest: int = 40  # read one by one after the coarse pass sees rest
    least: float = 0.5  # of the frames: a holder that is found in fewer has no motion
    straight: float = math.radians(30.0)  # largest angle to the columns that is taken for a turned camera
    alike: float = 1e-6  # difference of correlations of one image, as SOLVED of places
    copies: float = 0.1  # of the frames, at most, that are left out as repeated
    clear: float = 50.0  # standard uncertainties of a travel whose direction is determined


_READING = Reading()


def track(film: Path, *, settings: DicValidation, full: bool) -> xr.Dataset:
    """Follow the holder through the film; after rest, only every eighth frame is read."""
    source = film_of(film, settings)
    chosen = settings.tracking
    points, subsets = _points(source, chosen)
    static = chosen.static_frames or _static_frames(source, points[0], subsets[0])
    options: dict[str, Any] = {"subset": subsets, "static_frames": static, **chosen.masks}
    count, read_coarsely = len(source), 0
    coarse = np.unique(np.append(np.arange(0, count, _READING.every), count - 1))
    if not full and len(coarse) > 3 and count >= 4 * _READING.after_rest:
        # a coarse pass over the body alone finds rest; the frames that follow are thinned out
        body = imaging.track(source, points[:1], select=coarse, **options | {"subset": subsets[:1], "order": 3})
        read_coarsely, level = json.loads(body.attrs["work"]).get("frames_read", 0), body["dy"].values[:, 0]
        if np.isfinite(level[-1]):
            moving = np.flatnonzero(~(np.abs(level - level[-1]) < _READING.at_rest))
            last = int(coarse[min(int(moving[-1]) + 1, len(coarse) - 1)]) if len(moving) else 0
            dense = np.arange(min(count, max(last + _READING.after_rest, static)))
            options["select"] = np.union1d(dense, coarse)
    found = imaging.track(source, points, **options)
    work = json.loads(found.attrs["work"]) | {"frames_read": found.sizes["frame"]}
    work["coarse_frames_read"] = read_coarsely
    work["pixels_read"] = min(work["pixels_read"], work["pixels_total"])  # still frames are read twice
    kept = {"recorded": recorded_on(source), "light": light_of(source), "said_by_file": said_by_file(source)}
    if float(found["valid"].isel(point=0).mean()) < _READING.least:  # is it there in frames turned or mirrored?
        frames = np.stack([np.asarray(source[int(i)]) for i in np.flatnonzero(source.valid)[:: _READING.every]])
        turns = {"upside down": np.s_[:, ::-1], "mirrored": np.s_[:, :, ::-1], "turned by 180°": np.s_[:, ::-1, ::-1]}
        seen = {n: imaging.track(frames[turn].copy(), points[:1], subset=subsets[:1]) for n, turn in turns.items()}
        kept[TURNED] = json.dumps({name: float(one["valid"].mean()) for name, one in seen.items()})
    return found.assign_attrs(kept, work=json.dumps(work))


def _points(source: FrameSource, chosen: Tracking) -> tuple[list[tuple[float, float]], list[int]]:
    """Return the body's centre and the points of the line, with their subsets."""
    _, rows, columns = source.shape
    width = chosen.body_subset or min(_READING.largest_body, rows // 3, columns // 2)
    width += 1 - width % 2
    body = chosen.body or (0.5 * (columns - 1), max(0.25 * rows, width / 2 + 2))
    points, subsets = [(float(body[0]), float(body[1]))], [width]
    if chosen.line is not None:
        points += [(x, y) for x, y in np.linspace(*chosen.line, chosen.points).tolist()]
        subsets += [chosen.subset + 1 - chosen.subset % 2] * chosen.points
    half = width // 2
    for name, ends, beside in (("body", [body], 0), ("body_subset", [body], half), ("line", chosen.line or (), 0)):
        for x, y in ends:
            if not (beside <= round(x) < columns - beside and beside <= round(y) < rows - beside):
                what = f"a square of {width} px about " if beside else ""
                raise InputError(
                    f"tracking.{name}: {what}({x:g}, {y:g}) reaches beyond the images, which are {columns} px wide and "
                    f"{rows} px high; give px of the first image, x to the right and y down"
                ).because(f"tracking.{name}")
    return points, subsets


def _static_frames(source: FrameSource, centre: tuple[float, float], width: int) -> int:
    """Count the frames before the motion, by the growth of the difference from the first."""
    left, top = (max(0, round(c) - width // 2) for c in centre)
    part = source.roi(slice(top, top + width), slice(left, left + width))
    sound = np.flatnonzero(source.valid)[: round(_READING.most_static / _READING.margin) + 1]
    if len(sound) < 3:
        return 1
    images = np.stack([part[int(i)] for i in sound]).astype(float)
    # the light may drift; its mean is not motion
    images *= images[0].mean() / np.maximum(images.mean(axis=(1, 2), keepdims=True), 1e-9)
    apart = np.std(images[1:] - images[0], axis=(1, 2))
    moving = np.flatnonzero(apart > _READING.moving * np.minimum.accumulate(apart) + 1e-9)
    if moving.size:
        return max(1, int(_READING.margin * (moving[0] + 1)))
    return min(_READING.most_static, int(_READING.margin * len(sound)) or 1)


def repeated(track: xr.Dataset) -> NDArray[np.bool_]:
    """Find frames (frame,) that show the holder exactly as the one before, within the tolerance of the solver."""
    body, limits = track.isel(point=0), (("dx", SOLVED), ("dy", SOLVED), ("zncc", _READING.alike))
    same = np.all([np.abs(np.diff(body[of].values)) <= limit for of, limit in limits if of in body], axis=0)
    return np.append(False, same & (np.diff(track["frame"].values) == 1))


def motion(track: xr.Dataset, record: Path, *, settings: DicValidation) -> xr.Dataset:
    """Turn the tracks into metres with the view's calibration: the holder's height over time."""
    known = calibration.load_record(record)
    moved = camera_scale.motion(track, known, view=settings.view, measured=settings.measured_on)
    body = moved.isel(point=0)
    share = float(body["valid"].mean())
    if share < _READING.least:
        lost, times = np.unique(meanings(track["status"][~body["valid"].values, 0]), return_counts=True)
        raise InputError(
            f"the holder was found in {100 * share:.0f} % of the frames only (others: {lost[np.argmax(times)]}); give "
            "tracking.body a place [x, y] on the speckled holder that stays in the image while it falls, and that "
            "masks (tracking.regions, covers, obstructions) leave free"
        )
    x, y, u_x, u_y = (body[name].values for name in _ACROSS)
    away, noise = np.hypot(x, y), np.hypot(u_x, u_y)
    far, direction, u_direction = np.flatnonzero(away > 0.05 * np.nanmax(away, initial=0.0)), math.nan, math.nan
    if far.size > 3 and np.nanmax(away) > _READING.clear * np.nanmedian(noise):  # the angle to the image's columns
        weight = away[far] * np.sign(y[far])
        direction = math.atan2(float(weight @ x[far]), float(weight @ y[far]))
        beside = x[far] * math.cos(direction) - y[far] * math.sin(direction)
        memory = far.size / signals.independent_count(beside)
        u_direction = math.sqrt(memory * float(beside @ beside) / (far.size - 1) / float(weight @ weight))
    turn, tilt = direction if abs(direction) < _READING.straight else 0.0, settings.camera_tilt
    across, upwards = math.sin(turn) / math.cos(tilt.value), math.cos(turn) / math.cos(tilt.value)
    along, noise = upwards * y + across * x, np.hypot(upwards * u_y, across * u_x)
    copies = repeated(track)
    if copies.mean() < _READING.copies:  # a film without noise repeats itself at rest
        along[copies] = np.nan
    text = "displacement of the holder along its motion, upwards"
    table = with_u("displacement", "time", along, noise, "m", text, "(random)")
    turned, u_turned = (body[name].values for name in ("rotation", "u_rotation"))
    table |= with_u("rotation", "time", turned, u_turned, "rad", "rotation of the holder, clockwise", "(random)")
    text = "direction of the motion to the image's columns, to the right of upwards"
    table |= with_u("direction", (), direction, u_direction, "rad", text)
    size = float(moved["pixel_size"])
    sources = [Source(*(row[key] for key in Source._fields)) for row in json.loads(moved.attrs["budget"])]
    # the camera may be turned, or the body may move at an angle: the displacement is that along the motion, or less
    open_angle = {
        "direction of motion": (1.0 - math.cos(turn)) / math.sqrt(3.0),
        "tilt of the camera": math.hypot(math.tan(tilt.value) * tilt.u, math.sqrt(0.75) * tilt.u**2),
    }
    sources += [Source(name, 0.0, u, "1", size, "systematic") for name, u in open_angle.items() if u > 0.0]
    attrs = {
        "u_systematic_relative": combined_uncertainty(sources) / size,
        "budget": json.dumps(budget_rows(sources)),
        "calibration": moved.attrs["calibration"],
    }
    made = xr.Dataset(table, {"time": variable("time", track["time"].values, "s", "time in the film")}, attrs)
    return made.assign({name: moved[name] for name in ("pixel_size", "u_pixel_size")})


def bounces(motion: xr.Dataset, *, settings: DicValidation) -> xr.Dataset:
    """Find release, contacts, bounces and rest in the film's displacement."""
    del settings
    return signals.bounces(motion["displacement"])


def velocity(motion: xr.Dataset, bounces: xr.Dataset, *, settings: DicValidation) -> xr.Dataset:
    """Differentiate, with knots free to break where contacts begin and end."""
    del settings
    found = signals.velocity(motion["displacement"], events=bounces)
    return found.reset_coords("u_velocity").assign_attrs(found.attrs)


def keys(film: Path, track: xr.Dataset, bounces: xr.Dataset | None, *, settings: DicValidation) -> xr.Dataset:
    """Copy frames for the page, all over the first three impacts.

    Release, contacts, tops and rest are always among them; where none is known, the frames are spread over the film.
    """
    time = track["time"].values
    near, last = [0, time.size - 1], time.size
    if bounces is not None:
        of_impacts = (bounces[name].values[:IMPACTS] for name in ("touch_time", "liftoff_time", "apex_time"))
        events = np.hstack([bounces["release_time"], bounces["rest_time"], *of_impacts])
        found_at = [int(np.argmin(np.abs(time - t))) for t in events[np.isfinite(events)]]
        near, last = near + found_at, max(found_at, default=0)
    return key_frames(film_of(film, settings), track["frame"].values[thinned(range(last), near)])
