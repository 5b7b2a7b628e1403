"""Films of a Phantom camera: pixels, times, and every way in which such a file can be damaged."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from instruments.phantom import CineFrames, read
from instruments.phantom._film import linear_from_companded
from instruments.phantom._writer import Recording, write
from labpipe.errors import LabpipeError, SourceError
from labpipe.frames import FrameSource
from tests.faults import seeds

COUNT, ROWS, COLUMNS, SETUP = 6, 4, 8, 84  # of the film of the seeds
STAMPS = SETUP + 10412 + 8
FRAME = 8 + 2 * ROWS * COLUMNS
TABLE = STAMPS + 8 * COUNT + 8 + 4 * COUNT
FIRST = TABLE + 8 * COUNT
SAMPLES = Path(__file__).parents[2] / "../shared/samples/cine"
FORMATS = [(8, False), (10, False), (12, False), (14, False), (16, False), (10, True), (12, True)]


def film(path: Path, bits: int = 12, packed: bool = False, count: int = 6) -> np.ndarray:
    """Write random pixels; packed ones as bytes, under a header that is changed afterwards."""
    images = np.random.default_rng(bits).integers(0, 2**bits, (count, 12, 32)).astype(np.uint8 if bits == 8 else "u2")
    stored = images
    if packed:
        one_by_one = images[..., None] >> np.arange(bits, dtype=np.uint16)[::-1] & 1
        stored = np.packbits(one_by_one.astype(np.uint8).reshape(count, 12, -1), axis=2)[:, ::-1]
    recording = Recording(10_000, 5e-6, bits=8 if packed else bits, first_image=-2)
    write(path, stored, stored.shape, (np.arange(count) - 2) * 1e-4, recording)
    if packed:
        patched(path, 44 + 4, "i", 32)
        patched(path, 44 + 14, "HI", 16, {10: 256, 12: 1024}[bits])
        patched(path, 84 + 1588, "I", 32)
    return linear_from_companded()[images] if packed and bits == 10 else images


@pytest.mark.parametrize(("bits", "packed"), FORMATS)
def test_every_pixel_format_comes_back_unchanged_whole_and_in_part(tmp_path: Path, bits: int, packed: bool) -> None:
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
    view = frames.roi(slice(2, 9), slice(3, 22))
    assert view.shape == (6, 7, 19)
    assert np.array_equal(view[4], images[4, 2:9, 3:22])
    assert np.array_equal(view.roi(slice(1, 4), slice(5, None))[4], images[4, 3:6, 8:22])


def patched(path: Path, offset: int, layout: str, *values: float) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, data, offset, *values)
    path.write_bytes(bytes(data))
    return path


def test_an_unset_clock_falls_back_to_frame_numbers_with_a_flag(tmp_path: Path) -> None:
    film(tmp_path / "f.cine")
    frames = read(patched(tmp_path / "f.cine", 40, "I", 1_400_000_000))
    with pytest.warns(UserWarning, match="clock was not set"):
        assert frames.time.shape == (6,)
    np.testing.assert_allclose(frames.time, (np.arange(6) - 2) * 1e-4, atol=1e-8)


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
    data, generator = seeds.film_bytes(tmp_path), np.random.default_rng(1)
    settings = [84 + at for at in (140, 142, 768, 772, 808, 896, 1568, 1588, 1592, 5732, 5736, 10388)]
    places = [*range(0, 84, 2), *settings, *range(STAMPS - 8, FIRST, 4), FIRST, FIRST + 4]
    tracemalloc.start()
    for _ in range(300):
        damaged = bytearray(data)
        at, size = int(generator.choice(places)), int(generator.choice([1, 2, 4, 8]))
        old, bits = int.from_bytes(damaged[at : at + size], "little"), 8 * size
        values = (0, 1, 2**bits - 1, 2 ** (bits - 1) - 1, old + 1, old ^ 1 << int(generator.integers(bits)))
        damaged[at : at + size] = (values[int(generator.choice(6))] % 2**bits).to_bytes(size, "little")
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


def test_a_truncated_film_keeps_its_complete_frames_at_every_cut(tmp_path: Path, images: list[np.ndarray]) -> None:
    data = seeds.film_bytes(tmp_path)
    for cut in range(FIRST, len(data), 17):
        (tmp_path / "g.cine").write_bytes(data[:cut])
        complete = (cut - FIRST) // FRAME
        with pytest.warns(UserWarning, match=rf"g\.cine: {6 - complete} of 6 frames lies? beyond the end of the file"):
            frames = read(tmp_path / "g.cine")
        assert sound_frames(frames, images) == list(range(complete))


def changed(folder: Path, *changes: tuple[int, str, int], time: np.ndarray | None = None) -> Path:
    """Write the film of the seeds, with numbers changed at places."""
    path = folder / "a.cine"
    path.write_bytes(seeds.film_bytes(folder, COUNT if time is None else len(time), time=time))
    for change in changes:
        patched(path, *change)
    return path


@pytest.fixture
def images(tmp_path: Path) -> list[np.ndarray]:
    return list(read(changed(tmp_path)))


def sound_frames(frames: CineFrames, images: list[np.ndarray]) -> list[int]:
    """Frames marked valid, after comparing each with its image; the others must not be given."""
    for i, is_valid in enumerate(frames.valid):
        if is_valid:
            assert np.array_equal(frames[i], images[i])
        else:
            with pytest.raises(SourceError, match=f"frame {i}"):
                frames[i]
    return np.flatnonzero(frames.valid).tolist()


WRONG_PLACES = [
    *((frame, FIRST + frame * FRAME, "I", 8 + FRAME) for frame in (0, 4)),  # an annotation that ends in the next frame
    *((frame, TABLE + 8 * frame, "q", FIRST) for frame in (1, 5)),  # two frames at one place
    *((f, TABLE + 8 * f, "q", v) for f in (0, 3, 5) for v in (-(2**63), 2**63 - 1, FIRST + 4, FIRST + FRAME - 4)),
]


@pytest.mark.filterwarnings("ignore:.*lies? beyond the end of the file:UserWarning")
@pytest.mark.parametrize(("frame", "at", "layout", "value"), WRONG_PLACES)
def test_a_wrong_place_spoils_no_other_frame(
    tmp_path: Path, images: list[np.ndarray], frame: int, at: int, layout: str, value: int
) -> None:
    assert sound_frames(read(changed(tmp_path, (at, layout, value))), images) == [i for i in range(6) if i != frame]


@pytest.mark.parametrize("stated", [1, 3, 5, 7])
def test_a_count_that_the_stamps_and_the_offsets_contradict_is_refused(tmp_path: Path, stated: int) -> None:
    with pytest.raises(SourceError, match=rf"ImageCount is {stated}, .* of {COUNT} images"):
        read(changed(tmp_path, (20, "I", stated)))


def bursts(pause: float, length: int = 5, number: int = 3) -> np.ndarray:
    starts = np.arange(number) * (pause + length * 1e-4)
    return (starts[:, None] + np.arange(length) * 1e-4).ravel()


@pytest.mark.parametrize("pause", [0.01, 2.0, 86400.0])
def test_stamps_of_bursts_are_kept(tmp_path: Path, pause: float) -> None:
    time = bursts(pause)
    with pytest.warns(UserWarning, match=r"pauses 2 time|15 frames in 3 windows"):
        axis = read(changed(tmp_path, time=time)).time_axis
    np.testing.assert_allclose(axis.time, time, atol=2e-9)
    assert len(axis.warnings) == 1
    assert axis.interval == pytest.approx(1e-4, rel=1e-4)


SECONDS = STAMPS + 4  # of the first stamp; the fractions stand before them


@pytest.mark.parametrize("frame", [0, 2, 5, 9, 14])
@pytest.mark.parametrize("shift", [-1_000_000, 2_000_000_000])
def test_one_damaged_stamp_is_replaced_within_its_burst(tmp_path: Path, frame: int, shift: int) -> None:
    time = bursts(60.0)
    start = struct.unpack_from("<I", changed(tmp_path, time=time).read_bytes(), SECONDS)[0]
    stamp = start + int(time[frame]) + shift
    with pytest.warns(UserWarning, match=".") as caught:
        axis = read(changed(tmp_path, (SECONDS + 8 * frame, "I", stamp), time=time)).time_axis
    assert str(caught[0].message).startswith(f"1 time stamp is impossible (first at frame {frame})")
    others = np.arange(15) != frame
    np.testing.assert_allclose(axis.time[others], time[others], atol=2e-9)
    assert (np.diff(axis.time) > 0).all()


@pytest.mark.parametrize(("rate", "decimation"), [(0, 1.0), (10_000, -1.0), (10_000, float("inf")), (0, float("nan"))])
def test_without_stamps_and_rate_no_time_is_invented(tmp_path: Path, rate: int, decimation: float) -> None:
    path = changed(
        tmp_path,
        (STAMPS - 4, "H", 999),  # a block of an unknown kind instead of the stamps
        (SETUP + 768, "I", rate),
        (SETUP + 10388, "f", decimation),  # type: ignore[arg-type]
    )
    frames = read(path)
    assert frames.valid.all()
    with pytest.raises(SourceError, match="no frame has a time"):
        _ = frames.time


needs_samples = pytest.mark.skipif(not SAMPLES.is_dir(), reason="the public sample films are not beside the checkout")

# shape, first and last time in s
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
