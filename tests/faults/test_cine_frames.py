"""Films whose frames or times lie: what is damaged is flagged, what is whole is used."""

import struct
from pathlib import Path

import numpy as np
import pytest

from instruments.phantom import CineFrames, read
from instruments.phantom._times import TimeFlag
from labpipe.errors import SourceError
from tests.faults import seeds

COUNT, ROWS, COLUMNS = 6, 4, 8
SETUP = 84
STAMPS = SETUP + 10412 + 8
FRAME = 8 + 2 * ROWS * COLUMNS
TABLE = STAMPS + 8 * COUNT + 8 + 4 * COUNT
FIRST = TABLE + 8 * COUNT


def film(folder: Path, *changes: tuple[int, str, int], time: np.ndarray | None = None) -> Path:
    """Write the film of the seeds, with numbers changed at places."""
    data = bytearray(seeds.film_bytes(folder, COUNT if time is None else len(time), time=time))
    for offset, layout, value in changes:
        struct.pack_into("<" + layout, data, offset, value)
    path = folder / "a.cine"
    path.write_bytes(data)
    return path


@pytest.fixture
def images(tmp_path: Path) -> list[np.ndarray]:
    return list(read(film(tmp_path)))


def sound_frames(frames: CineFrames, images: list[np.ndarray]) -> list[int]:
    """Frames marked valid, after comparing each with its image; the others must not be given."""
    for i, is_valid in enumerate(frames.valid):
        if is_valid:
            assert np.array_equal(frames[i], images[i])
        else:
            with pytest.raises(SourceError, match=f"frame {i}"):
                frames[i]
    return np.flatnonzero(frames.valid).tolist()


# --- places of frames ---------------------------------------------------------------------------


@pytest.mark.parametrize("frame", [0, COUNT - 2])
def test_an_annotation_that_reaches_into_the_next_frame_is_no_frame(
    tmp_path: Path, images: list[np.ndarray], frame: int
) -> None:
    """The size that stands there is right, but it is the next frame's."""
    path = film(tmp_path, (FIRST + frame * FRAME, "I", 8 + FRAME))
    assert sound_frames(read(path), images) == [i for i in range(COUNT) if i != frame]


@pytest.mark.parametrize("frame", [1, COUNT - 1])
def test_of_two_frames_at_one_place_one_is_refused(tmp_path: Path, images: list[np.ndarray], frame: int) -> None:
    path = film(tmp_path, (TABLE + 8 * frame, "q", FIRST))
    assert sound_frames(read(path), images) == [i for i in range(COUNT) if i != frame]


@pytest.mark.filterwarnings("ignore:.*lies? beyond the end of the file:UserWarning")
@pytest.mark.parametrize("value", [-(2**63), 2**63 - 1, FIRST + 4, FIRST + FRAME - 4])
@pytest.mark.parametrize("frame", [0, 3, 5])
def test_an_offset_anywhere_spoils_no_other_frame(
    tmp_path: Path, images: list[np.ndarray], frame: int, value: int
) -> None:
    path = film(tmp_path, (TABLE + 8 * frame, "q", value))
    assert sound_frames(read(path), images) == [i for i in range(COUNT) if i != frame]


@pytest.mark.parametrize("stated", [1, 3, 5, 7])
def test_a_count_that_the_stamps_and_the_offsets_contradict_is_refused(tmp_path: Path, stated: int) -> None:
    with pytest.raises(SourceError, match=rf"ImageCount is {stated}, .* of {COUNT} images"):
        read(film(tmp_path, (20, "I", stated)))


@pytest.mark.parametrize(("black", "white"), [(-5, 4064), (64, 2**20), (64, 64), (4064, 64)])
def test_levels_that_cannot_be_are_the_range_of_the_type(tmp_path: Path, black: int, white: int) -> None:
    path = film(tmp_path, (SETUP + 5732, "i", black), (SETUP + 5736, "i", white))
    assert read(path).levels == (0.0, 4095.0)


# --- times ----------------------------------------------------------------------------------------


def bursts(pause: float, length: int = 5, number: int = 3) -> np.ndarray:
    starts = np.arange(number) * (pause + length * 1e-4)
    return (starts[:, None] + np.arange(length) * 1e-4).ravel()


@pytest.mark.parametrize("pause", [0.01, 2.0, 86400.0])
def test_stamps_of_bursts_are_kept(tmp_path: Path, pause: float) -> None:
    time = bursts(pause)
    with pytest.warns(UserWarning, match=r"pauses 2 time|dropped"):
        axis = read(film(tmp_path, time=time)).time_axis
    np.testing.assert_allclose(axis.time, time, atol=2e-9)
    assert not (axis.flag & TimeFlag.RECONSTRUCTED).any()
    assert np.flatnonzero(axis.flag & TimeFlag.AFTER_GAP).tolist() == [5, 10]
    assert axis.interval == pytest.approx(1e-4, rel=1e-4)


SECONDS = STAMPS + 4  # of the first stamp; the fractions stand before them


@pytest.mark.parametrize("frame", [0, 2, 5, 9, 14])
@pytest.mark.parametrize("shift", [-1_000_000, 2_000_000_000])
def test_one_damaged_stamp_is_replaced_within_its_burst(tmp_path: Path, frame: int, shift: int) -> None:
    time = bursts(60.0)
    start = struct.unpack_from("<I", film(tmp_path, time=time).read_bytes(), SECONDS)[0]
    stamp = start + int(time[frame]) + shift
    with pytest.warns(UserWarning, match=".") as caught:
        axis = read(film(tmp_path, (SECONDS + 8 * frame, "I", stamp), time=time)).time_axis
    assert str(caught[0].message).startswith("1 time stamp")
    assert np.flatnonzero(axis.flag & TimeFlag.RECONSTRUCTED).tolist() == [frame]
    others = np.arange(15) != frame
    np.testing.assert_allclose(axis.time[others], time[others], atol=2e-9)
    assert (np.diff(axis.time) > 0).all()


@pytest.mark.parametrize("damaged", [(1, 2), (6, 7, 8), (0, 5, 10)])
def test_some_damaged_stamps_do_not_outvote_the_others(tmp_path: Path, damaged: tuple[int, ...]) -> None:
    time = np.arange(15) * 1e-4
    changes = [(SECONDS + 8 * i, "I", 1_700_000_900 - i) for i in damaged]
    with pytest.warns(UserWarning, match=f"{len(damaged)} time stamp"):
        axis = read(film(tmp_path, *changes, time=time)).time_axis
    np.testing.assert_allclose(axis.time, time, atol=2e-8)


def test_one_frame_has_the_time_of_its_stamp(tmp_path: Path) -> None:
    axis = read(film(tmp_path, time=np.array([0.25]))).time_axis
    assert axis.time == pytest.approx([0.25], abs=1e-9)
    assert axis.flag.tolist() == [0]


@pytest.mark.parametrize(("rate", "decimation"), [(0, 1.0), (10_000, -1.0), (10_000, float("inf")), (0, float("nan"))])
def test_without_stamps_and_rate_no_time_is_invented(tmp_path: Path, rate: int, decimation: float) -> None:
    path = film(
        tmp_path,
        (STAMPS - 4, "H", 999),  # a block of an unknown kind instead of the stamps
        (SETUP + 768, "I", rate),
        (SETUP + 10388, "f", decimation),  # type: ignore[arg-type]
    )
    frames = read(path)
    assert frames.valid.all()
    with pytest.raises(SourceError, match="no frame has a time"):
        _ = frames.time


# --- anything at all ------------------------------------------------------------------------------
