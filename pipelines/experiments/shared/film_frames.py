"""Films in experiments: opening, recording date, key frames."""

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import UTC, datetime
from math import ceil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr
from numpy.typing import NDArray

import instruments
from labpipe.errors import EXCHANGED, InputError
from labpipe.frames import FrameSource
from labpipe.report import Gallery, Picture, looks
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.shared.exclusions import excluded, without_frames

Drawn = tuple[NDArray[np.uint8], str, str, float | None]
"""A picture (BGR) of a frame, its description, its caption and its place on a chart."""


def film_of(path: Path, settings: Any) -> FrameSource:
    """Open the film of an experiment; frames that its settings exclude count as damaged."""
    film = open_film(path, settings.frame_rate, settings.channel)
    return without_frames(film, excluded(settings, "frames", len(film)))


def open_film(path: Path, frame_rate: Quantity | None = None, channel: str | None = None) -> FrameSource:
    """Open a film of any known format; exported images need the frame rate, in colour a channel.

    Raises
    ------
    InputError
        The file holds readings, not images; or rows and columns of its images are exchanged.
    """
    fps = None if frame_rate is None else frame_rate.value
    reader = instruments.by_name(instruments.identify(path, fps=fps))
    given: dict[str, Any] = {"fps": fps, "channel": channel}
    options = {name: value for name, value in given.items() if name in reader.option_names()}
    found = instruments.read(path, instrument=reader.name, **options)
    if isinstance(found, xr.Dataset):
        raise InputError(f"{path}: expected a film, found a table of readings")
    if _is_exchanged(found):
        _, rows, columns = found.shape
        raise InputError(
            f"{path}: rows of its images fit together when they are {rows} px long, not {columns} px as its header "
            "says: width and height are exchanged"
        ).because(EXCHANGED)
    return found


def _is_exchanged(film: FrameSource, left: float = 0.5, beside: float = 0.25) -> bool:
    """Return whether the pixels of an image are neighbours at the distance of its height, not of its width.

    Of the differences between stated neighbours at most a part is ``left`` between true ones, nor are rows alike at a
    distance so far ``beside`` it: those that are alike at any distance are a pattern.
    """
    _, rows, columns = film.shape
    sound = np.flatnonzero(film.valid) if rows != columns else np.empty(0, int)
    if not sound.size or 2 * rows * columns < 3 * max(rows, columns):
        return False
    image = np.asarray(film[int(sound[sound.size // 2])], np.float64)

    def apart(flat: NDArray[np.float64], distance: float) -> float:
        by = round(distance)
        return float(np.mean(np.abs(flat[by:] - flat[:-by])))

    # rows of a file may begin at the bottom
    return any(
        apart(flat, rows) < left * min(apart(flat, d) for d in (columns, (1 - beside) * rows, (1 + beside) * rows))
        for flat in (image.ravel(), image[::-1].ravel())
    )


def recorded_on(film: object) -> str:
    """Return the day of the film's trigger (UTC) as text, "" when the file does not know it."""
    header = getattr(film, "header", None)
    if header is None or not hasattr(header, "trigger"):
        return ""
    day = datetime.fromtimestamp(int(header.trigger) >> 32, UTC).date()
    # a camera whose clock was never set counts from 1970 or from its own first day, both before there were such films
    return "" if day.year < 2000 else str(day)


def key_frames(film: FrameSource, chosen: Iterable[int], widest: int = 640) -> xr.Dataset:
    """Copy a few frames for the page, reduced to 8 bit and to its width [px].

    Returns
    -------
    Dataset
        ``image`` (key, y, x) grey levels 0 to 255, ``frame`` (key,), ``key_time`` (key,) [s], and
        the scalar ``reduction``, px of the film per px of the image. Attribute ``header``: the
        entries of the film's header, one line each.
    """
    sound = [int(i) for i in chosen if film.valid[i]]
    if not sound:
        raise InputError("all frames selected for display are damaged in the film")
    low, high = film.levels
    _, rows, columns = film.shape
    factor = max(1.0, columns / widest)
    size = (round(columns / factor), max(1, round(rows / factor)))
    grey = ((film[i].astype(float) - low) * (255.0 / max(high - low, 1.0)) for i in sound)
    eight_bit = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in grey)
    images = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in eight_bit]
    return xr.Dataset(
        {
            "image": variable(("key", "y", "x"), np.stack(images), "1", "grey level of a key frame"),
            "frame": variable("key", np.array(sound), "1", "frame of the film"),
            "key_time": variable("key", film.time[sound], "s", "time in the film"),
            "reduction": variable((), columns / size[0], "1", "px of the film per px of the image"),
        },
        attrs={
            "header": "\n".join(_header_lines(getattr(film, "header", None))),
            "work": json.dumps({"key_frames": len(sound)}),
        },
    )


def meanings(flags: xr.DataArray) -> NDArray[np.str_]:
    """Return the meaning of each value of a variable of flags (CF ``flag_values``, ``flag_meanings``)."""
    names = dict(zip(flags.attrs["flag_values"], str(flags.attrs["flag_meanings"]).split(), strict=True))
    return np.array([names[int(code)] for code in np.atleast_1d(flags.values)], dtype=str)


def thinned(wanted: Iterable[int], keys: Collection[int], most: int = 60) -> list[int]:
    """Return the key frames and, evenly, as many of the others as a strip holds: few enough to step through."""
    others = np.array(sorted(set(wanted) - set(keys)), int)
    room = max(min(most - len(keys), others.size), 0)
    evenly = others[np.linspace(0, others.size - 1, room).round().astype(int)] if room else others[:0]
    return sorted({*evenly.tolist(), *keys})


def strip(
    title: str, drawn: Sequence[Drawn], *, start: int = 0, quality: int = 65, most: int = 1_500_000, **more: str
) -> Gallery:
    """Make frames a strip to step through; of more than fit into a part of the page every second one.

    ``start`` is the frame that is shown first; ``quality`` is that of JPEG; ``most`` is the size in base64.
    """
    frames = [Picture(jpeg(image, quality), alt, caption, at) for image, alt, caption, at in drawn]
    kept = [*range(len(frames))]
    while len(kept) > 3 and sum(len(frames[i].address) for i in kept) > most:
        kept = sorted({*kept[::2], start})
    step = "Step with ‹ and ›, or with the arrow keys on the slider."
    shown = [frames[i] for i in kept]
    return Gallery(title, shown, start=kept.index(start), **more | {"caption": f"{more.get('caption', '')} {step}"})


def _header_lines(header: Any) -> list[str]:
    """List the single values of a header, those of its parts too; tables are left out."""
    if not is_dataclass(header):
        return []
    lines = []
    for entry in fields(header):
        value = getattr(header, entry.name)
        if is_dataclass(value):
            lines += _header_lines(value)
        elif isinstance(value, int | float | str) and value != "":
            lines.append(f"{entry.name.replace('_', ' ')}: {value}")
    return lines


def jpeg(image: NDArray[np.uint8], quality: int = 90) -> bytes:
    """Encode a grey or colour (BGR) image; half the colour resolution would blur a thin coloured circle."""
    sampling = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, *sampling])
    return data.tobytes()


def ink(place: int) -> tuple[int, ...]:
    """Return a colour of the charts to draw with, as BGR: blue, orange, green, purple, ochre."""
    return tuple(bytes.fromhex(looks([None] * (place + 1))[place].light[1:])[::-1])


def drawing_of(key: xr.Dataset, least: int = 480) -> tuple[NDArray[Any], float, float]:
    """Return a BGR copy of a key frame to draw on, and scale and shift that take px of the film to px of it.

    Frames of fewer px are enlarged by a whole factor; both take the centre of a pixel to the centre of its enlargement.
    """
    image = key["image"].values
    factor = max(1, ceil(least / max(image.shape)))
    colour = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2BGR)
    scale = factor / float(key["reduction"])
    drawn = cv2.resize(colour, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    return drawn, scale, scale / 2 - 0.5


@dataclass(frozen=True, slots=True)
class DrawnFilm:
    """A film to watch, and the results of its frames.

    ``frame`` (evaluated,) are those of a result, ascending. ``drawn`` takes one of :func:`key_frames` and its place
    among these. ``jumps`` are frames worth seeing, by name.
    """

    source: FrameSource
    frame: NDArray[np.integer] = field(default_factory=lambda: np.empty(0, int))
    drawn: Callable[[xr.Dataset, int], Drawn] | None = None
    jumps: Mapping[str, int] = field(default_factory=dict)

    def shown(self, index: int, is_drawn: bool = True) -> tuple[NDArray[np.uint8] | None, str]:
        """Return a frame as wide as a page shows it, with its results if wanted, and its caption.

        There is no picture of a frame that is damaged or excluded, or that the film does not have.
        """
        if not 0 <= index < len(self.source):
            return None, f"the film has no frame {index}"
        head = f"frame {index}, {self.source.time[index] * 1e3:.2f} ms in the film"
        if not self.source.valid[index]:
            return None, f"{head}: damaged or excluded, it is not shown"
        key, at = key_frames(self.source, [index]).isel(key=0), int(np.searchsorted(self.frame, index))
        if self.drawn is not None and at < self.frame.size and self.frame[at] == index:
            image, _, caption, _ = self.drawn(key, at)
            return image if is_drawn else drawing_of(key)[0], caption
        missing = "this frame was not evaluated" if self.frame.size else "no result of this film is up to date"
        return drawing_of(key)[0], f"{head}; {missing}"
