"""Films of a Phantom camera: pixels, times, and every way in which such a file can be damaged."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from instruments.phantom import read
from instruments.phantom._film import linear_from_companded
from instruments.phantom._times import TimeFlag
from instruments.phantom._writer import Recording, companded_from_linear, write
from labpipe.errors import InputError, LabpipeError, SourceError
from labpipe.frames import FrameSource

SAMPLES = Path(__file__).parents[2] / "../shared/samples/cine"
FORMATS = [(8, False), (10, False), (12, False), (14, False), (16, False), (10, True), (12, True)]


def film(path: Path, bits: int = 12, packed: bool = False, count: int = 6) -> np.ndarray:
    generator = np.random.default_rng(bits)
    top = 2 ** (12 if (bits, packed) == (10, True) else bits)
    images = generator.integers(0, top, (count, 12, 32)).astype(np.uint8 if bits == 8 else "u2")
    if (bits, packed) == (10, True):  # only levels that the companded scale can hold
        images = linear_from_companded()[companded_from_linear()[images]]
    recording = Recording(10_000, 5e-6, bits=bits, packed=packed, first_image=-2)
    write(path, images, images.shape, (np.arange(count) - 2) * 1e-4, recording)
    return images


@pytest.mark.parametrize(("bits", "packed"), FORMATS)
def test_every_pixel_format_comes_back_unchanged(tmp_path: Path, bits: int, packed: bool) -> None:
    images = film(tmp_path / "f.cine", bits, packed)
    frames = read(tmp_path / "f.cine")
    assert isinstance(frames, FrameSource)
    assert frames.shape == images.shape
    assert all(np.array_equal(frame, image) for frame, image in zip(frames, images, strict=True))
    assert np.array_equal(frames[-1], images[-1])
    np.testing.assert_allclose(frames.time, (np.arange(6) - 2) * 1e-4, atol=1e-9)
    np.testing.assert_allclose(frames.exposure, 5e-6, rtol=1e-4)
    assert frames.valid.all()
    assert frames.time_axis.warnings == ()


@pytest.mark.parametrize(("bits", "packed"), FORMATS)
def test_a_region_of_interest_equals_the_cut_frame(tmp_path: Path, bits: int, packed: bool) -> None:
    images = film(tmp_path / "f.cine", bits, packed)
    view = read(tmp_path / "f.cine").roi(slice(2, 9), slice(3, 22))
    assert view.shape == (6, 7, 19)
    assert np.array_equal(view[4], images[4, 2:9, 3:22])
    assert np.array_equal(view.roi(slice(1, 4), slice(5, None))[4], images[4, 3:6, 8:22])


def patched(path: Path, offset: int, layout: str, *values: float) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, data, offset, *values)
    path.write_bytes(bytes(data))
    return path


STAMPS_AT = 84 + 10412 + 8
FRAME = 8 + 12 * 32 * 2
FIRST = 84 + 10412 + 8 + 48 + 8 + 24 + 48


def test_an_unset_clock_falls_back_to_frame_numbers_with_a_flag(tmp_path: Path) -> None:
    film(tmp_path / "f.cine")
    frames = read(patched(tmp_path / "f.cine", 40, "I", 1_400_000_000))
    with pytest.warns(UserWarning, match="clock was not set"):
        assert frames.time.shape == (6,)
    np.testing.assert_allclose(frames.time, (np.arange(6) - 2) * 1e-4, atol=1e-8)
    assert all(frames.time_axis.flag & TimeFlag.CLOCK_UNSET)


def test_dropped_frames_are_counted_where_they_are_missing(tmp_path: Path) -> None:
    images = np.zeros((6, 4, 16), np.uint8)
    time = np.array([0, 1, 2, 5, 6, 7]) * 1e-4
    write(tmp_path / "f.cine", images, images.shape, time, Recording(10_000, 1e-6, bits=8))
    with pytest.warns(UserWarning, match="2 frame"):
        axis = read(tmp_path / "f.cine").time_axis
    assert list(axis.missing_before) == [0, 0, 0, 2, 0, 0]
    np.testing.assert_allclose(axis.time, time, atol=1e-9)
    assert "2 frames were dropped" in axis.warnings[0]


@pytest.mark.parametrize(
    ("offset", "layout", "value", "words"),
    [
        (0, "H", 0, "not a Phantom"),
        (4, "H", 1, "JPEG"),
        (44 + 14, "H", 24, "colour"),
        (84 + 808, "I", 3, "colour filter"),
        (44 + 14, "H", 12, "no known pixel format"),
        (20, "I", 0, "holds no image"),
        (20, "I", 2**31, "table of 2147483648 image offsets"),
        (44 + 20, "I", 77, "biSizeImage"),
        (84 + 140, "H", 0, 'mark "ST"'),
    ],
)
def test_a_refusal_names_what_was_found(tmp_path: Path, offset: int, layout: str, value: int, words: str) -> None:
    film(tmp_path / "f.cine")
    with pytest.raises(SourceError, match=words) as caught:
        read(patched(tmp_path / "f.cine", offset, layout, value))
    assert "f.cine" in str(caught.value)
    assert caught.value.hint


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_damaged_headers_are_errors_that_name_the_file_or_frames_of_the_declared_size(tmp_path: Path) -> None:
    """Three hundred damages of the headers, the settings that are read, the tags, the table and the frames."""
    film(tmp_path / "f.cine")
    data, generator = (tmp_path / "f.cine").read_bytes(), np.random.default_rng(1)
    settings = [84 + at for at in (140, 142, 768, 772, 808, 896, 1568, 1588, 1592, 5732, 5736, 10388)]
    places = [*range(0, 84, 2), *settings, *range(STAMPS_AT - 8, FIRST, 4), FIRST, FIRST + 4]
    tracemalloc.start()
    for _ in range(300):
        damaged = bytearray(data)
        at, size = int(generator.choice(places)), int(generator.choice([1, 2, 4, 8]))
        old = int.from_bytes(damaged[at : at + size], "little")
        values = (
            0,
            1,
            2 ** (8 * size) - 1,
            2 ** (8 * size - 1) - 1,
            old + 1,
            old ^ 1 << int(generator.integers(8 * size)),
        )
        damaged[at : at + size] = (int(generator.choice(6)) and values[int(generator.choice(6))]).to_bytes(
            size + 1, "little"
        )[:size]
        (tmp_path / "g.cine").write_bytes(bytes(damaged))
        try:
            frames = read(tmp_path / "g.cine")
            assert all(frames[int(i)].shape == frames.shape[1:] for i in np.flatnonzero(frames.valid))
            assert frames.time.shape == (len(frames),)
            assert np.isfinite(frames.time).all()
        except LabpipeError as error:
            assert "g.cine" in str(error)  # noqa: PT017 - either outcome is right, none is silent
    assert tracemalloc.get_traced_memory()[1] < 64e6
    tracemalloc.stop()


def test_a_truncated_film_keeps_its_complete_frames_at_every_cut(tmp_path: Path) -> None:
    images = film(tmp_path / "f.cine")
    data = (tmp_path / "f.cine").read_bytes()
    for cut in range(FIRST, len(data), 97):
        (tmp_path / "g.cine").write_bytes(data[:cut])
        complete = (cut - FIRST) // FRAME
        with pytest.warns(UserWarning, match=rf"g\.cine: {6 - complete} of 6 frames lies? beyond the end of the file"):
            frames = read(tmp_path / "g.cine")
        assert frames.valid.sum() == complete
        if complete:
            assert np.array_equal(frames[complete - 1], images[complete - 1])


def test_the_writer_refuses_what_the_format_cannot_hold(tmp_path: Path) -> None:
    images = np.zeros((2, 4, 10), np.uint16)
    with pytest.raises(InputError, match="multiple of 4"):
        write(tmp_path / "f", images, images.shape, np.zeros(2), Recording(1, 0.5, bits=10, packed=True))
    with pytest.raises(InputError, match="no format"):
        write(tmp_path / "f", images, images.shape, np.zeros(2), Recording(1, 0.5, bits=11))
    with pytest.raises(InputError, match="2 were announced"):
        write(tmp_path / "f", images[:1], images.shape, np.zeros(2), Recording(1, 0.5))
    with pytest.raises(InputError, match="exposure"):
        write(tmp_path / "f", images, images.shape, np.zeros(2), Recording(1, 1.5))
    assert not list(tmp_path.iterdir())


needs_samples = pytest.mark.skipif(not SAMPLES.is_dir(), reason="the public sample films are not beside the checkout")

# shape, first and last time in s, sum of the middle frame's pixels; the unpacked sums are those
# that the independent reader pims 0.7 returns for the same frames
REAL = {
    "decimated_781.cine": ((15, 256, 256), -0.60167271, -0.60011771),
    "mono_10bit_packed_235_frames.cine": ((235, 32, 256), 0.010071, 2.350071),
    "packed_12bpp.cine": ((6, 128, 256), 0.60614204, 0.65614204),
    "phantom_v12_raw_16bpp.cine": ((6, 128, 256), 0.97189255, 1.02189255),
    "phantom_v1610_raw.cine": ((6, 128, 256), -0.84470110, -0.79470110),
    "phantom_v9_raw_16bpp.cine": ((6, 128, 256), 4.247823, 4.264489),
}


@needs_samples
@pytest.mark.filterwarnings("ignore:1 time stamp")
@pytest.mark.parametrize("name", sorted(REAL))
def test_real_films_read(name: str) -> None:
    shape, first, last = REAL[name]
    frames = read(SAMPLES / name)
    assert frames.shape == shape
    assert frames.valid.all()
    assert frames.time[0] == pytest.approx(first, abs=1e-7)
    assert frames.time[-1] == pytest.approx(last, abs=1e-5)
    black, white = frames.levels
    assert black <= np.median(frames[0]) <= white
