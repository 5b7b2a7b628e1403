"""Mistakes of a laboratory with a film of a contact are noticed and named.

A film is long to measure, so the edits are made on what is measured in its frames: the series that
the stage ``radius`` would give of the edited film.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.judging import Judgement
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.contact_area import checks
from pipelines.experiments.contact_area.comparison import comparison
from pipelines.experiments.contact_area.measured import impacts
from pipelines.experiments.contact_area.model import model
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.judgements import believed
from pipelines.experiments.shared.settings import Sphere
from tests.mistakes.rows import misspelt

Change = Callable[[xr.Dataset], xr.Dataset]
_FILM, _CAMERA = "film/a.cine", "calibration/camera_under.toml"
_COUNT, _STEP = 900, 1e-4
_CONTEXT = Context("film", "contact_area", "", "", "", True)
SETTINGS = ContactArea(
    kind="contact_area",
    film=_FILM,
    camera=_CAMERA,
    height=Quantity(1.5e-3, 5e-6, "m"),
    wavelength=Quantity(633e-9, 0.0, "m"),
    sphere=Sphere(radius=Quantity(9.525e-3, 5e-6, "m"), mass=Quantity(0.505, 5e-4, "kg"), material="acrylic"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One edit of what the frames show, or of the settings, and what must be said."""

    name: str
    level: str
    words: tuple[str, ...]
    change: Change = lambda film: film
    settings: dict[str, Any] = field(default_factory=dict)


def _larger(factor: float) -> Change:
    return lambda film: film.assign({n: film[n] * factor for n in ("radius", "u_radius", "radius_systematic")})


def _faster(factor: float) -> Change:
    """A frame rate that is stated so many times too high."""
    return lambda film: film.assign_coords(time=film["time"] / factor)


def _frames(chosen: Callable[[Any], Any]) -> Change:
    """Show other frames at the times of the first ones."""

    def change(film: xr.Dataset) -> xr.Dataset:
        which = chosen(np.arange(_COUNT))
        shown = film.isel(frame=which)
        return shown.assign_coords(time=("frame", _STEP * np.arange(which.size)), frame=np.arange(which.size))

    return change


def _exchanged(a: int, b: int) -> Change:
    def chosen(frames: Any) -> Any:
        frames[[a, b]] = frames[[b, a]]
        return frames

    return _frames(chosen)


def _at_rest(film: xr.Dataset) -> xr.Dataset:
    return film.assign(in_contact=film["in_contact"] | True, radius=film["radius"].fillna(0.0) * 0.0 + 4e-4)


def _refocused(film: xr.Dataset) -> xr.Dataset:
    return film.assign(centre_x=film["centre_x"] + 10.0 * (film["frame"] >= 182))


def _by_edge(film: xr.Dataset) -> xr.Dataset:
    return film.assign(method=film["method"].copy(data=2 * film["method"].values))


def _copied(film: xr.Dataset) -> xr.Dataset:
    for name in ("centre_x", "centre_y"):
        film[name].values[180] = film[name].values[179]
    return film


def _lit(clipped: float = 0.0) -> str:
    """What is measured of the light of a film."""
    return json.dumps({"clipped": clipped, "level": 255.0})


def _said(**of_file: Any) -> Change:
    """What the file of the film says of itself."""
    return lambda film: film.assign_attrs(said_by_file=json.dumps(of_file))


def _light(stated: float) -> dict[str, Any]:
    """A wavelength that the session states for one of 633 nm."""
    return {
        "change": lambda film: film.assign_attrs(phase_scale_ratio=stated / 632.8),
        "settings": {"wavelength": Quantity(stated * 1e-9, 0.0, "m")},
    }


def _exposed(seconds: float) -> dict[str, Any]:
    return {"exposure": Quantity(seconds, 0.0, "s")}


_WHITE: dict[str, Any] = {"wavelength": None}
_VIEW, _RATE = "scale in calibration/camera_under.toml is wrong, of another view", "frame rate is"
ROWS = (
    # calibration and settings
    Row("scale of the front view", "impossible", (_VIEW, "36 times"), _larger(36.0), _WHITE),
    Row("532 nm for 633 nm", "impossible", ("probably 633 nm", "532 nm"), **_light(532.0)),
    Row("frame rate ten times", "impossible", (_RATE, "10 times"), _faster(10.0)),
    Row("frame rate half", "impossible", (_RATE, "0.5 times"), _faster(0.5)),
    Row("exposure in ms for us", "doubtful", ("2.00 µs", "2.00 ms", "is used"), _said(exposure=2e-6), _exposed(2e-3)),
    Row(
        "height 2 for 1.5 mm",
        "doubtful",
        ("drop height is probably 1.50",),
        settings={"height": Quantity(2e-3, 5e-6, "m")},
    ),
    # frames
    Row("neighbours exchanged", "doubtful", ("exchanged",), _exchanged(176, 177)),
    Row("one frame twice", "doubtful", ("repeated frame", "180"), _copied),
    Row("film backwards", "impossible", ("reverse order",), _frames(lambda i: i[::-1])),
    Row("sphere at rest", "impossible", ("at rest",), _at_rest),
    # view and light
    Row("lens out of focus", "doubtful", ("not resolved",), _by_edge),
    Row("lens refocused in a contact", "doubtful", ("frame 182", "10 px", "refocused"), _refocused),
    Row(
        "over-exposed by far",
        "doubtful",
        ("40 % of the pixels", "over-exposed"),
        lambda film: film.assign_attrs(light=_lit(0.4)),
    ),
)


@pytest.fixture(scope="module")
def film() -> xr.Dataset:
    """What the stage ``radius`` makes of a clean film at 10 kHz."""
    fall = (materials.load("acrylic"), 9.525e-3, 0.505, 1.5e-3, 0.13)
    drop = contact.drop(*fall, substrate="sapphire", times=_STEP * np.arange(1300))
    random = np.random.default_rng(1)
    a: Floats = drop["contact_radius"].values[:_COUNT]
    seen, u = a > 50e-6, np.full(_COUNT, 1e-7)
    values = {
        "radius": np.where(seen, a + u * random.standard_normal(_COUNT), np.nan),
        "u_radius": u,
        "radius_systematic": 2.2e-3 * np.where(seen, a, np.nan),
        "in_contact": seen,
        "valid": np.ones(_COUNT, bool),
        "centre_x": random.normal(200.0, 0.01, _COUNT),
        "centre_y": random.normal(60.0, 0.01, _COUNT),
        "u_centre_x": np.full(_COUNT, 0.01),
        "u_centre_y": np.full(_COUNT, 0.01),
    }
    flags = {"flag_values": [0, 1, 2], "flag_meanings": "none fringe_fit edge"}
    return xr.Dataset(
        {name: ("frame", array) for name, array in values.items()} | {"method": ("frame", 1 * seen, flags)},
        {"time": ("frame", _STEP * np.arange(_COUNT)), "frame": np.arange(_COUNT), "pixel_size": 2.17e-6},
        {"phase_scale_ratio": 1.0, "u_phase_scale_ratio": 1e-3, "u_systematic_relative": 2.2e-3, "light": _lit()},
    )


def judgement_of(film: xr.Dataset, **changes: Any) -> xr.Dataset:
    settings = msgspec.structs.replace(SETTINGS, **changes)
    found = impacts(film, settings=settings)
    made = model(film, found, None, None, None, settings=settings)
    compared = comparison(film, found, made, settings=settings)
    return checks.judgement(film, found, made, compared, settings=settings, context=_CONTEXT)


def _judged(film: xr.Dataset, **changes: Any) -> Judgement:
    return believed(judgement_of(film, **changes))


def test_clean_film_is_believed(film: xr.Dataset) -> None:
    found = _judged(film)
    assert (found.believable, found.findings) == ("yes", ())
    assert 6 < found.n_made <= 12


@pytest.mark.parametrize("mistake", ROWS, ids=lambda row: row.name)
def test_mistake_is_noticed_and_named(film: xr.Dataset, mistake: Row) -> None:
    found = _judged(mistake.change(film.copy(deep=True)), **mistake.settings)
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings)
    assert found.believable == mistake.level, said
    assert [word for word in mistake.words if word not in said] == [], said
    assert misspelt(said) == []
