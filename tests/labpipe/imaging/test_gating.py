"""Which frames are worth reading: no contact is missed, most of a flight is left out."""

import numpy as np
import pytest

from labpipe.frames import ArrayFrames
from labpipe.imaging.gating import contact_windows


def film(contacts: list[tuple[int, int]], count: int = 400, radius: int = 20) -> ArrayFrames:
    """Grey frames with a dark disc during each contact."""
    generator = np.random.default_rng(1)
    images = generator.normal(120, 5, (count, 96, 128)).clip(0, 255).astype(np.uint8)
    y, x = np.ogrid[:96, :128]
    disc = (x - 70) ** 2 + (y - 44) ** 2 < radius**2
    for start, stop in contacts:
        images[start:stop, disc] = generator.normal(24, 5, (stop - start, disc.sum())).clip(0, 255)
    return ArrayFrames(images, levels=(0.0, 255.0))


@pytest.mark.parametrize("start", range(40, 48))
def test_an_impact_of_a_few_frames_is_found_whenever_it_falls(start: int) -> None:
    found = contact_windows(film([(start, start + 6), (200, 212)]))
    assert set(range(start, start + 6)) | set(range(200, 212)) <= set(found.frames.tolist())
    assert len(found.frames) < 50


def test_the_glance_reads_a_small_part_of_the_film() -> None:
    source = film([(50, 60)])
    found = contact_windows(source)
    assert found.pixels_read < 0.3 * np.prod(source.shape)


def test_windows_are_times_around_the_contacts() -> None:
    found = contact_windows(film([(50, 60), (300, 400)]))
    assert len(found.windows) == 2
    (start, end), (rest, last) = found.windows
    assert 40 < start <= 48
    assert 61 <= end < 70
    assert rest <= 298
    assert last == 399


def test_without_anything_dark_every_frame_is_read() -> None:
    assert contact_windows(film([])).windows is None


def test_a_film_of_few_frames_is_read_whole() -> None:
    assert contact_windows(film([(2, 4)], count=9)).windows is None
