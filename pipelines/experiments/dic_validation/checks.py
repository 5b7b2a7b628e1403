"""Checks of a film of a falling holder: its frames and light, view, free fall, bounces, and the laser."""

import json
from collections.abc import Iterator
from math import hypot
from typing import Any

import numpy as np
import xarray as xr

from labpipe.judging import Cause, Check, Level, compared, in_words, not_made
from labpipe.report import quantity, value_with_uncertainty
from labpipe.signals import estimate_noise
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from labpipe.workflow.fields import REFERENCE
from pipelines.experiments.dic_validation.comparison import rows
from pipelines.experiments.dic_validation.measured import SOLVED, TURNED, repeated
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared import fall_checks, judgements
from pipelines.experiments.shared.fall_checks import HEIGHT, Fall, G
from pipelines.experiments.shared.film_checks import LONGER, of_film, of_frames, wrong_rate
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title
from pipelines.experiments.shared.record_checks import break_in, longest_run

_GRAVITY = Quantity(9.81, 0.0, "m/s2")
_BETWEEN_DAYS = 0.01
"""Relative difference of two drops from one height, set anew on another day."""
_FOUND = 0.9  # of the frames in which the holder should be found
_STAYS = 5  # frames for which a size that has changed remains
_UPSIDE_DOWN = "the film is upside down: the camera was, or the film was turned or mirrored when it was exported"
_MENDS = {f"tracking.{name}": f"tracking.{name}" for name in ("body", "body_subset", "line")}
_MENDS |= {name: f"tracking.{name}" for name in ("regions", "covers", "obstructions")}
_POLYGON = "the polygon is not drawn in px of the first image, x to the right and y down, or around something else"
_FAILED = {
    reason: f"{setting} does not lie in the images" if reason == setting else _POLYGON
    for reason, setting in _MENDS.items()
}
_FAILED |= {
    "track": "the film is not what the session says, or was not copied whole",
    "motion": "the calibration record is of another view or day, or tracking.body is not on the holder",
    "bounces": "the film shows no drop or a part of it: another film, a cut one, or tracking.body is not on the holder "
    "(as in a film that was turned or mirrored)",
}
FOUND, SIZE, PLACE = "holder is found", "size of the image", "place of the image"
_STEPS = ("track", "motion", "bounces", "comparison", "laser")
TITLES = {
    **judgements.OF_FILM,
    "view of the holder": Title("The holder is found in every frame.", (FOUND,)),
    "steady view": Title("Size and place of the holder's image do not jump between frames.", (SIZE, PLACE)),
    **fall_checks.OF_FALL,
    "comparison with the laser": Title("Film and laser show drops from one height.", (HEIGHT,)),
}


@judgements.judging(*_STEPS, rests_on=("laser_experiment",), expected=("comparison", "laser"), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: DicValidation, context: Context) -> Scene:
    """Judge one film; a step without a result is judged by its error."""
    track, motion, bounces, _, dropped = map(given.get, _STEPS)
    checks = of_film(context, settings, track, _FAILED, _MENDS)
    checks.append(judgements.day_known(motion, settings.camera, settings.film))
    relative = 0.0 if motion is None else float(motion.attrs["u_systematic_relative"])
    if track is not None:
        checks += _of_frames(track, bounces, settings, relative)
    if motion is not None and bounces is not None and bounces.sizes["impact"]:
        fall = Fall(settings.film, bounces, relative)
        checks += [
            fall_checks.direction(fall, _UPSIDE_DOWN, file=fall.name),
            fall_checks.acceleration(fall, _GRAVITY),
            fall_checks.restitution(fall),
        ]
        if dropped is None or not dropped.sizes.get("impact"):
            checks.append(not_made(HEIGHT, "a laser experiment"))
        else:
            seen, own = fall.value("drop_height")
            expected, u = (
                float(dropped["incoming_speed"][0]) ** 2 / (2 * _GRAVITY.value),
                hypot(own, seen * fall.relative),
            )
            text = f"{fall.name}: the holder fell {value_with_uncertainty(seen, u, 'm')}, at the laser "
            text += quantity(expected, "m")
            other = _BETWEEN_DAYS * expected
            place: dict[str, Any] = {"allowance": 3 * other, "file": fall.name}
            checks.append(compared(HEIGHT, text, seen, u, expected, other, **place))
    laser = (settings.laser_experiment or "").removeprefix(REFERENCE)
    another = f"the film may show another drop than {laser}: another sphere, height or day"

    def of_height(factor: float) -> str:
        text = f"the film is of a drop from a height {in_words(factor)} times that of {laser}"
        return f"{text}: film or laser_experiment is another one"

    causes = [
        judgements.wrong_scale({G: 1.0, HEIGHT: 1.0}, settings.camera),
        wrong_rate({G: 2.0}, settings.frame_rate, track, settings.film),
        Cause({HEIGHT: 1.0}, of_height, setting="laser_experiment"),
    ]
    return Scene(checks, causes, given.each([rows]), basis=basis, unstated=another)


def _of_frames(
    track: xr.Dataset, bounces: xr.Dataset | None, settings: DicValidation, relative: float
) -> Iterator[Check]:
    """Evaluate the view of the film, whose scale has a ``relative`` u, and the order of its frames."""
    film, of_body, frame = settings.film, track.isel(point=0), track["frame"].values
    share = float(of_body["valid"].mean())
    level: Level | None = None if share >= _FOUND else "doubtful"
    cause = "damaged or missing frames, a film that is upside down, or tracking.body, [x to the right, y down], is not "
    cause, place = f"{cause}on the holder", dict[str, Any](setting="tracking.body")
    message = f"{film}: the holder was found in {100 * share:.1f} % of the frames"
    way, of_way = max(json.loads(track.attrs.get(TURNED, '{"": 0}')).items(), key=lambda one: one[1])
    if of_way > _FOUND:
        message += f", in {100 * of_way:.0f} % of them where the film is {way}"
        cause, place = f"the film is {way}: the camera was, or it was turned or mirrored by the export", {"file": film}
    yield Check(FOUND, message, level, cause=cause, **place)
    copies = repeated(track)
    count, first = longest_run(np.diff(track["frame"].values) == 1)
    steady = track.isel(point=0, frame=slice(first, first + count + 1))
    size, place_of = 0.5 * (steady["stretch_x"].values + steady["stretch_y"].values), steady["dy"].values
    place_of = np.where(copies[first : first + count + 1], np.nan, place_of)  # those are reported as such
    zoomed = "zoom, focus or distance of the lens changed within the film, films of two views were joined, or "
    zoomed += "tracking.body holds more than the holder: draw tracking.regions around what moves"
    knocked = "frames were lost there and the others stamped anew, or the camera or its tripod was knocked"
    for name, values, cause in ((SIZE, size, zoomed), (PLACE, place_of, knocked)):
        known = np.isfinite(values)
        if known.sum() < _STAYS:
            yield not_made(name, "a holder in five frames in a row")
            continue
        noise = max(estimate_noise(values[known]).sigma, SOLVED)
        if name == SIZE:  # a view that has changed stays so, a frame that is blurred does not
            near = np.pad(values[known], _STAYS // 2, mode="symmetric")
            values[known] = np.median(np.lib.stride_tricks.sliding_window_view(near, _STAYS), axis=1)
        broken = break_in(values, noise)
        text = f"the {name} does not jump"
        if broken is not None:
            by, when = broken[1], quantity(float(steady["time"][broken[0]]), "s")
            how = f"{by:+.2g} px" if name == PLACE else f"{100 * by:+.2f} %"
            text = f"the {name} jumps by {how} at {when}"
        matters = broken is not None and (name == PLACE or abs(broken[1]) > relative)
        yield Check(name, f"{film}: {text}", "doubtful" if matters else None, cause=cause, file=film)
    begin, end = track["time"].values[:-1], track["time"].values[1:]
    if bounces is None:  # after rest only every eighth frame is read
        is_even = end - begin < LONGER * np.median(end - begin)
        moves = np.arange(begin.size) < np.flatnonzero(is_even).max(initial=0)
    else:
        moves = ~((end <= float(bounces["release_time"])) | (begin >= float(bounces["rest_time"])))  # NaN is never
    yield from of_frames(film, frame, track["time"].values, moves, copies[1:], of_body["dy"].values)
