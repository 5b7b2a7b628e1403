"""Every sentence of "Methods, to paste" says what was done: with the branches of a film and a sweep."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from labpipe.units import Quantity
from pipelines.experiments.contact_area import page as film
from pipelines.experiments.dma import page as rheometer
from pipelines.experiments.shared.settings import Sphere

SPHERE = Sphere(radius=Quantity(9.5e-3, 5e-6, "m"), mass=Quantity(0.5, 1e-3, "kg"), material="acrylic")


@pytest.mark.parametrize(
    ("codes", "says", "hides"),
    [
        ([1, 1, 1], ("in 3 frames by fitting the interference phase", "smear"), ("edge", "interpolation")),
        ([2, 2], ("in 2 frames from the edge",), ("interference", "smear")),
        ([1, 2, 3], ("in 1 frame by fitting", "in 1 frame from the edge", "at rest by interpolation"), ()),
        ([5], ("left free",), ("edge", "smear")),
        ([4], ("in no frame",), ("edge", "interference")),
    ],
)
def test_a_film_tells_how_its_frames_were_measured(codes: list[int], says: Any, hides: Any) -> None:
    flag = {"flag_values": range(6), "flag_meanings": "none fringe_fit edge between_equal_frames - fringe_fit_open_gap"}
    radius = xr.Dataset({"method": ("frame", codes, flag), "in_contact": ("frame", np.ones(len(codes)))})
    settings: Any = SimpleNamespace(sphere=SPHERE, wavelength=Quantity(633e-9, 0.0, "m"))
    _holds(film._methods(settings, radius), says, hides)


@pytest.mark.parametrize(
    ("asked", "mode", "says", "hides"),
    [
        ("free", "tension", ("every isotherm had a shift of its own",), ("the shifts followed", "2 (1 + ν) G")),
        ("wlf", "shear", ("the shifts followed the WLF law", "2 (1 + ν) G with ν = 0.35"), ("of its own",)),
        ("arrhenius", "bending", ("the shifts followed the Arrhenius law",), ("of its own", "2 (1 + ν) G")),
    ],
)
def test_a_rheometer_tells_what_its_shifts_followed_and_where_tension_comes_from(
    asked: str, mode: str, says: Any, hides: Any
) -> None:
    law = {"name": "wlf", "T_ref": 20.0, "parameters": [0.1, 0.01], "C1": 10.0, "u_C1": 0.1, "C2": 100.0, "u_C2": 1.0}
    curve = xr.Dataset(
        {"T_ref": 20.0, "storage_residual": ("point", [0.01, -0.01]), "loss_residual": ("point", [0.02, np.nan])},
        coords={"temperature": [0.0, 20.0, 40.0]},
        attrs={"law": json.dumps(law | {"chi_square": 2.0, "freedom": 2}), "vertical_law": "none"},
    )
    settings: Any = SimpleNamespace(mode=mode, nu=Quantity(0.35, 0.0, "1"), fit=SimpleNamespace(law=asked))
    text = rheometer._methods(settings, curve)
    _holds(text, (*says, "at 3 temperatures", "1.00 % (E′) and 2.00 % (E″)"), hides)


def _holds(text: str, says: tuple[str, ...], hides: tuple[str, ...]) -> None:
    assert [words for words in says if words not in text] == [], text
    assert [words for words in hides if words in text] == [], text
    assert text.strip().endswith(".")
