"""A film watched in the page: what is drawn on its frames, against the stored results, and by keys."""

import base64
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.session import process, result
from tests.labpipe.report.conftest import Browser, opened
from tests.pipelines.app.conftest import Page

FRONT, UNDER = "film/ptfe_front.cine", "film/acrylic_1p5mm_film_under.cine"


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session whose films are measured; the last frames of the front film were not evaluated."""
    folder = tmp_path_factory.mktemp("filmed") / "session"
    shutil.copytree(Path(__file__).parents[3] / "sample_data/thesis-small", folder)
    process(folder, ["ptfe_film/bounces", "acrylic_1p5mm_film/radius"], jobs=0)
    return folder


def drawn(page: Page, name: str, index: int) -> tuple[np.ndarray, tuple[int, int], str]:
    """Return the places (x, y) that differ where results are drawn, the size of the picture, and the caption."""
    found = [page.told(f"api/film?name={name}&index={index}&drawn={is_drawn}") for is_drawn in (1, 0)]
    pictures = [np.frombuffer(base64.b64decode(one["image"].partition(",")[2]), np.uint8) for one in found]
    coloured, plain = (cv2.imdecode(data, cv2.IMREAD_COLOR).astype(int) for data in pictures)
    assert found[0]["caption"] == found[1]["caption"]
    return np.argwhere(np.abs(coloured - plain).max(axis=2) > 60)[:, ::-1], plain.shape[1::-1], found[0]["caption"]


def test_what_is_drawn_is_what_was_found(serving: Callable[[Path], Page], filmed: Path) -> None:
    page = serving(filmed)
    told = page.told(f"api/film?name={UNDER}")
    radius = result(filmed, "acrylic_1p5mm_film", "radius")
    at = radius.isel(frame=int(np.nanargmax(radius["radius"].values)))
    assert (told["experiment"], told["frames"]) == ("acrylic_1p5mm_film", 29)
    assert told["jumps"]["Largest radius"] == int(at["frame"])
    assert told["jumps"]["First contact"] == int(radius["frame"][radius["in_contact"]][0])
    places, size, caption = drawn(page, UNDER, int(at["frame"]))
    scale = size[0] / 416  # px of the picture per px of the film
    centre = scale * (np.array([at["centre_x"], at["centre_y"]]) + 0.5) - 0.5  # pixels of the film are squares
    from_centre = np.hypot(*(places - centre).T)
    assert np.median(from_centre) == pytest.approx(scale * float(at["radius"] / at["pixel_size"]), abs=1.5)
    assert caption.startswith(f"frame {int(at['frame'])}, {float(at['time']) * 1e3:.2f} ms in the film, radius ")
    track = result(filmed, "ptfe_film", "track").isel(point=0)
    for index in (0, 60):
        one = track.sel(frame=index)
        places, size, _ = drawn(page, FRONT, index)
        square = [(float(one[x] + one[f"d{x}"]) + 0.5) * size[0] / 52 - 0.5 for x in ("x", "y")]
        assert np.mean([places.min(axis=0), places.max(axis=0)], axis=0) == pytest.approx(square, abs=2.0)


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Browser]:
    yield from opened(tmp_path)


def test_a_film_is_played_and_stepped_through_by_keys(
    window: Browser, serving: Callable[[Path], Page], filmed: Path
) -> None:
    page = serving(filmed)
    caption, image = "document.getElementById('film-caption').textContent", "document.getElementById('film-image')"
    window.visit(f"{page.address}#film/{FRONT.replace('/', '%2F')}", width=390)
    window.until(f"{caption}.startsWith('frame 0, 0.00 ms')")
    for key, frame in (("End", 119), ("ArrowLeft", 118), ("Home", 0), ("ArrowRight", 1)):
        window.key(key)
        window.until(f"{caption}.startsWith('frame {frame},')")
        assert window.until(f"{image}.complete && {image}.naturalWidth") > 300
    window.run("document.getElementById('film-jumps').firstChild.click()")
    first = page.told(f"api/film?name={FRONT}")["jumps"]["First contact"]
    window.until(f"{caption}.startsWith('frame {first},')")
    window.run("document.getElementById('film-play').click()")
    window.until(f"film.isPlaying && film.index > {first + 5}")
    window.until("document.getElementById('film-play').textContent === 'Play'")  # at the end
    assert window.run(caption).startswith("frame 119,")
    source = window.run(f"{image}.src")
    window.run("document.getElementById('film-drawn').click()")
    window.until(f"{image}.src !== {source!r}")
    assert window.run("document.documentElement.scrollWidth") <= 390
    assert window.complaints() == []
