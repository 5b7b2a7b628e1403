"""Exported images with wrong bits: a PNG's own checksums tell every one of them."""

import random
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from instruments import images
from labpipe.errors import InputError, SourceError

Amount = Callable[[int, int], int]
IMAGES = np.random.default_rng(4).integers(0, 255, (3, 12, 16)).astype(np.uint8)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


@pytest.mark.filterwarnings("ignore:.*1 of 3 images is:UserWarning")
def test_any_wrong_bit_of_a_png_spoils_this_image_alone(tmp_path: Path, amount: Amount) -> None:
    for i, image in enumerate(IMAGES):
        (tmp_path / f"f{i}.png").write_bytes(png(image))
    data, rng, head = png(IMAGES[1]), random.Random(8), 33
    for _ in range(amount(100, 3_000)):
        damaged = bytearray(data)
        damaged[rng.randrange(head, len(data))] ^= 1 << rng.randrange(8)
        (tmp_path / "f1.png").write_bytes(damaged)
        film = images.read(tmp_path, fps=100.0)
        assert film.valid.tolist() == [True, False, True]
        view = film.roi(slice(2, 8), slice(0, 4))
        assert view.valid.tolist() == [True, False, True]
        with pytest.raises(SourceError, match=r"f1\.png"):
            film[1]
    assert np.array_equal(film[-1], IMAGES[2])


def folder(path: Path, names: list[str]) -> Path:
    for name in names:
        (path / name).write_bytes(png(IMAGES[0]))
    return path


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["first.png"], "has no number in its name"),
        (["a1.png", "b1.png"], "number 1 occurs twice"),
        (["notes.txt"], "holds no image"),
    ],
)
def test_a_folder_that_is_no_film_is_refused(tmp_path: Path, names: list[str], says: str) -> None:
    with pytest.raises(SourceError, match=says):
        images.read(folder(tmp_path, names), fps=100.0)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frame_rate_that_is_none_is_refused(tmp_path: Path, fps: float) -> None:
    with pytest.raises(InputError, match="frame rate must be positive"):
        images.read(folder(tmp_path, ["f0.png"]), fps=fps)


@pytest.mark.parametrize(
    "data",
    [
        b"II*\0\xff\xff\xff\x7f",  # an offset outside of the file
        b"II*\0\0\0\0\0",  # no page
        b"MM\0+" + bytes(4) + b"\xff" * 8,
    ],
)
def test_a_tiff_that_contradicts_itself_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(SourceError, match="the TIFF is cut off or damaged"):
        images.read(tmp_path / "a.tif", fps=100.0)


def test_a_film_in_files_of_several_pages_each_is_refused(tmp_path: Path) -> None:
    assert cv2.imwritemulti(str(tmp_path / "f0.tif"), list(IMAGES))
    with pytest.raises(SourceError, match="holds 3 images, expected one per file"):
        images.read(tmp_path, fps=100.0)
    film = images.read(tmp_path / "f0.tif", fps=100.0)
    assert all(np.array_equal(film[i], IMAGES[i]) for i in (-1, 0, 1))


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25, (32, 24), False)
    for level in (0, 60, 120):
        writer.write(np.full((24, 32), level, np.uint8))
    writer.release()
    return path


@pytest.mark.filterwarnings("ignore:a.avi")
def test_a_video_is_a_film_in_any_order(video: Path) -> None:
    film = images.read(video, fps=1000.0, exposure=1e-4)
    assert film.shape == (3, 24, 32)
    assert film.valid.all()
    assert film.levels == (0.0, 255.0)
    assert film.exposure.tolist() == [1e-4] * 3
    np.testing.assert_allclose(film.time, [0, 1e-3, 2e-3])
    for i in (2, 0, 1, -1):
        assert abs(float(film[i].mean()) - 60 * (i % 3)) < 3
    view = film.roi(slice(4, 8), slice(0, 16))
    assert [frame.shape for frame in view] == [(4, 16)] * 3
    with pytest.raises(IndexError, match="frame 3 of 3"):
        film[3]
    with pytest.raises(InputError, match="region of interest"):
        film.roi(slice(99, 120), slice(0, 4))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kept", [40, 2000, -40])
def test_a_cut_video_gives_the_frames_that_there_are_or_none(video: Path, kept: int) -> None:
    video.write_bytes(video.read_bytes()[:kept])
    try:
        film = images.read(video, fps=1000.0)
        assert [frame.shape for frame in film] == [(24, 32)] * len(film)
    except SourceError as error:
        assert "a.avi" in str(error)  # noqa: PT017
