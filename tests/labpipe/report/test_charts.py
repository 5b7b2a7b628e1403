"""What a chart refuses, and what of it reaches the page."""

import base64

import numpy as np
import pytest
from hypothesis import given, strategies as st

from labpipe.errors import InputError
from labpipe.report import Band, LineChart, Series
from labpipe.report._packing import pack, thin
from labpipe.report._pictures import static_picture, thumbnail
from tests.rounding import rounding


def positions(axis):
    return np.frombuffer(base64.b64decode(axis), "<f8")


def curve(packed):
    data = np.frombuffer(base64.b64decode(packed["data"]), "<f4").astype(float)
    return packed["offset"] + packed["scale"] * data


def chart(*series, **more):
    return LineChart("c", "x / s", "y / m", series, **more)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Series("a", [1, 2], [1]), r'"a": arrays of different lengths \(x 2, y 1\)'),
        (lambda: Series("a", [1, np.nan], [1, 2]), "1 of 2 x values are NaN or infinite"),
        (lambda: Series("a", [1, 2], [1, np.inf]), "1 of 2 y values are infinite; use NaN"),
        (lambda: Series("a", [[1, 2]], [[1, 2]]), "x has 2 dimensions; expected one"),
        (lambda: Band("b", [1], [1], [1, 2]), "different lengths"),
        (chart, "has nothing to draw: 0 series"),
        (lambda: chart(Series("a", [], [])), "has nothing to draw: 1 series"),
        (lambda: chart(Series("a", [2, 1], [0, 0])), "descends.*use ScatterChart for loops"),
        (lambda: chart(Series("a", [1], [1], on_hover=True)), "has nothing to draw: 1 series"),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_its_name(make, message):
    with pytest.raises(InputError, match=message):
        make()


@given(offset=st.floats(-1e9, 1e9), size=st.floats(1e-9, 1e9), n=st.integers(3, 50))
def test_packed_numbers_are_the_given_ones_to_float32_of_their_range(offset, size, n):
    x = np.linspace(0.5, 2.5, n)
    y = offset + size * np.sin(np.arange(n))
    packed = pack(thin(chart(Series("a", x, y), Series("b", x.copy(), -y)), 10**6))
    assert [s["axis"] for s in packed["series"]] == [0, 0]  # common positions are stored once
    assert np.allclose(positions(packed["axes"][0]), x, rtol=0, atol=1e-6 * (x[1] - x[0]))
    spread = np.ptp(y)
    # With an offset below a hundred half ranges the plain float32 is kept: 6e-8 of the size.
    assert np.abs(curve(packed["series"][0]["y"]) - y).max() <= 1e-5 * spread + rounding(10, abs(offset))


def test_a_long_recording_fits_its_bytes_and_keeps_every_sample_of_an_impact():
    t = np.arange(1_000_000) / 50_000
    y = np.random.default_rng(0).normal(size=t.size)
    y[654_321] = 99.0
    long = chart(Series("a", t, y), Series("b", t, -y), views=(("all", 0.0, 20.0), ("impact", 4.0, 4.001)))
    thinned = thin(long, 200_000)
    packed = pack(thinned)
    assert len(str(packed)) < 200_000
    x = positions(packed["axes"][0])
    inside = (x >= 4.0 - 1e-9) & (x <= 4.001 + 1e-9)
    wanted = (t >= 4.0) & (t <= 4.001)
    assert np.allclose(x[inside], t[wanted], atol=1e-9)
    assert np.allclose(curve(packed["series"][0]["y"])[inside], y[wanted], atol=1e-5)
    assert curve(packed["series"][0]["y"]).max() == pytest.approx(99.0)
    assert "of 1000000 samples" in thinned.notes[0]


@pytest.mark.parametrize(
    "series",
    [
        Series("constant", [1.0, 2.0], [5.0, 5.0]),
        Series("all gaps", [1.0, 2.0], [np.nan, np.nan]),
        Series("gap", [1.0, 2.0, 3.0], [1.0, np.nan, 2.0], style="step"),
        Series("points with errors", [1.0, 2.0], [1.0, 2.0], "points", u=[0.1, np.nan]),
        Series("float32", np.float32([1, 2]), np.float32([3, 4])),
        Series("large", [1.0, 2.0], [1e9, 1e9 + 1]),
        Series("_hidden $x$ \ud800 \x00 \U0001f600", [1.0], [0.0]),
        Series("outside float32", [1.0, 2.0, 3.0], [1e200, -2e200, 3e200]),
    ],
    ids=lambda s: s.name[:8],
)
def test_awkward_series_are_packed_and_drawn_without_a_warning(series):
    series.y.flags.writeable = False  # what is given is never modified
    for scale in ("linear", "log"):
        awkward = chart(series, y_scale=scale, x_scale=scale)
        thinned = thin(awkward, 10**6)
        assert static_picture(thinned).lstrip().startswith(b"<svg")
        assert thumbnail(awkward).startswith(b"<svg")
        if scale == "linear":
            packed = pack(thinned)["series"][0]["y"]
            assert curve(packed) == pytest.approx(series.y, rel=6e-8, nan_ok=True)


def test_a_family_takes_its_colours_from_a_scale_and_is_named_at_its_ends():
    """Twenty-one temperatures have as many colours, in their order, and none has the dashes of a role."""
    x = np.geomspace(0.1, 10, 9)
    family = [
        Series(f"{5 * k} °C", x, x * 0 + 2.0**k, "points" if k == 20 else "line", level=k / 20) for k in range(21)
    ]
    made = thin(chart(*family, Series("model", x, x, role="model"), x_scale="log", y_scale="log"), 10**6)
    levels = [drawn for drawn in made.series if drawn.source.level is not None]
    assert len({drawn.look.light for drawn in levels}) == len({drawn.look.dark for drawn in levels}) == 21
    assert all(drawn.is_marked and not drawn.look.dash for drawn in levels[:-1])
    packed = pack(made)["series"]
    assert [entry["isLabelled"] for entry in packed] == [True] * 21 + [False]
    assert static_picture(made).lstrip().startswith(b"<svg")
