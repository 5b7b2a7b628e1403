"""A synthetic session with films: the front view together with the laser, and the view under the disc."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labpipe.arrays import Floats
from pipelines.rig.fall import Body, DropRig, fall
from pipelines.rig.film_front import FrontCamera, write_front_film
from pipelines.rig.film_under import UnderCamera, write_under_film
from pipelines.rig.session_text import from_library, height_name, section, write_truth
from pipelines.rig.solids import specimen_of

FRONT_HEIGHT, UNDER_HEIGHT = 7e-3, 1.5e-3  # m
_IMPACTS = 3
_BODY_ROW = 0.4
FULL_TIMES = np.arange(9367, dtype=np.float64) / 10_000
"""Of the frames of a film of full size [s], as the thesis's films have them."""

_SLOW = 5e-3  # s between the frames where little happens


@dataclass(frozen=True, slots=True)
class Bursts:
    """When a small film has its frames; s.

    ``spacing`` apart from ``before`` to ``after`` each of the first three touches, as at 10,000
    frames a second; ``slow`` apart otherwise, until the third; and ``rest`` after it, when the last
    bounces of acrylic from 1.5 mm are over.
    """

    spacing: float = 1e-4
    before: float = 0.4e-3
    after: float = 1.4e-3
    slow: float = _SLOW
    rest: float = 0.62
    frames_at_rest: int = 8


def write_front(
    folder: Path, material: str, height: float, camera: FrontCamera, seed: int, rig: DropRig | None = None
) -> str:
    """Film a drop from the front; returns the film's name in the session."""
    rig = rig or DropRig()
    body = Body(specimen_of(material), height, rig.radius, rig.mass, rig.floor, rig.disc)
    motion = fall(body, camera.duration - camera.release + 1e-3)
    name = f"film/{material}_front.cine"
    truth = write_front_film(folder / name, motion, height, camera, seed)
    write_truth(folder, f"{material}_front", truth, indent=None)
    return name


def write_under(folder: Path, stem: str, body: Body, camera: UnderCamera, time: Floats, seed: int) -> str:
    """Film a drop through the disc; returns the film's name in the session."""
    name = f"film/{stem}.cine"
    truth = write_under_film(folder / name, body, camera, time, seed)
    write_truth(folder, stem, truth, indent=None)
    return name


def burst_times(body: Body, release: float, bursts: Bursts) -> Floats:
    """Choose the times of a small film: bursts around the first impacts, few frames else, and rest.

    Real cameras record so too (image-based triggering, or a film cut to the impacts).
    """
    # Each flight is shorter than the first.
    longest = 1.2 * _IMPACTS * np.sqrt(8 * body.height / 9.81)
    touches = release + fall(body, float(longest)).touch[:_IMPACTS]
    pieces = [np.arange(t - bursts.before, t + bursts.after, bursts.spacing) for t in touches]
    slow = np.arange(0.0, touches[-1], bursts.slow)
    apart = np.min(np.abs(slow[:, None] - touches[None, :]), axis=1) > bursts.after
    last = touches[-1] + bursts.rest + _SLOW * np.arange(bursts.frames_at_rest)
    times = np.unique(np.concatenate([*pieces, slow[apart], last]).round(7))
    return np.asarray(times)


def front_section(film: str, camera: FrontCamera, height: float = FRONT_HEIGHT) -> str:
    """Return the table of the front film in session.toml."""
    # The body falls through the image; above and below it stays the same share of what is left.
    row = _BODY_ROW * (camera.rows - height / camera.pixel_size)
    subset = 2 * int(min(row - 3, 100)) + 1
    middle = 0.5 * (camera.columns - 1)
    small = 31 if camera.rows > 200 else min(21, 2 * (camera.columns // 6) + 1)
    places = {"middle": middle, "row": f"{row:.1f}", "left": small, "right": camera.columns - 1 - small}
    sizes = {"body_subset": subset, "points": 50 if camera.rows > 200 else 6, "subset": small}
    return section("dic_validation", film=film, height_name=height_name(height), **places, **sizes)


def under_section(
    film: str, name: str = "acrylic_film", height: float = UNDER_HEIGHT, *, extra: str = "", source: str = ""
) -> str:
    """Return the table of a film under the disc; ``source`` as for :func:`.drop_section`."""
    source = source or from_library("acrylic")
    return section("contact_area", name=name, film=film, height=height, extra=extra, source=source)
