"""Exported images with wrong bits: a PNG's own checksums tell every one of them."""

import random
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from instruments import image_stack
from labpipe.errors import SourceError

Amount = Callable[[int, int], int]
IMAGES = np.random.default_rng(4).integers(0, 255, (3, 12, 16)).astype(np.uint8)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def test_any_wrong_bit_of_a_png_spoils_this_image_alone(tmp_path: Path, amount: Amount) -> None:
    for i, image in enumerate(IMAGES):
        (tmp_path / f"f{i}.png").write_bytes(png(image))
    data, rng, head = png(IMAGES[1]), random.Random(8), 33
    for _ in range(amount(100, 3_000)):
        damaged = bytearray(data)
        damaged[rng.randrange(head, len(data))] ^= 1 << rng.randrange(8)
        (tmp_path / "f1.png").write_bytes(damaged)
        film = image_stack.read(tmp_path, fps=100.0)
        assert film.valid.tolist() == [True, False, True]
        view = film.roi(slice(2, 8), slice(0, 4))
        assert view.valid.tolist() == [True, False, True]
        with pytest.raises(SourceError, match=r"f1\.png"):
            film[1]
    assert np.array_equal(film[-1], IMAGES[2])


@pytest.mark.parametrize("kept", [33, 60, -13, -1])
def test_a_png_cut_anywhere_is_no_frame(tmp_path: Path, kept: int) -> None:
    for i, image in enumerate(IMAGES):
        (tmp_path / f"f{i}.png").write_bytes(png(image)[: kept if i == 1 else None])
    film = image_stack.read(tmp_path, fps=100.0)
    assert film.valid.tolist() == [True, False, True]


def test_bytes_behind_a_png_are_noticed(tmp_path: Path) -> None:
    (tmp_path / "f0.png").write_bytes(png(IMAGES[0]) + b"more")
    assert not image_stack.read(tmp_path, fps=100.0).valid.any()
