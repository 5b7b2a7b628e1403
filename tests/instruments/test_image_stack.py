"""Exported films: order, gaps, times, damage and bombs."""

import random
import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

import instruments
from labpipe.errors import InputError, SourceError
from labpipe.frames import FrameSource, IncompleteFilmWarning


def images(count: int, dtype: type = np.uint8) -> np.ndarray:
    generator = np.random.default_rng(3)
    return generator.integers(0, np.iinfo(dtype).max, (count, 12, 20)).astype(dtype)


def write_folder(folder: Path, names: list[str], dtype: type = np.uint8) -> np.ndarray:
    folder.mkdir(exist_ok=True)
    film = images(len(names), dtype)
    for name, image in zip(names, film, strict=True):
        assert cv2.imwrite(str(folder / name), image)
    return film


@pytest.mark.parametrize("form", ["a{}.png", "a{}_12bit.tif"])
def test_images_are_sorted_by_the_number_that_varies_not_by_name(tmp_path: Path, form: str) -> None:
    film = write_folder(tmp_path / "f", [form.format(number) for number in (9, 10, 11)])
    found = instruments.read(tmp_path / "f", fps=1000.0)
    assert isinstance(found, FrameSource)
    assert instruments.identify(tmp_path / "f") == "image_stack"
    np.testing.assert_array_equal(np.stack(list(found)), film)
    np.testing.assert_allclose(found.time, [0, 1e-3, 2e-3])
    np.testing.assert_array_equal(found.roi(slice(2, 5), slice(3, 9))[-1], film[-1, 2:5, 3:9])
    write_folder(tmp_path / "g", ["f10.png", "f20.png", "f30.png"])
    with pytest.warns(UserWarning, match="go up by 10, so its times do by 10 / frame rate"):
        np.testing.assert_allclose(instruments.read(tmp_path / "g", fps=1000.0).time, [0, 1e-2, 2e-2])


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
@pytest.mark.parametrize("cut", [20, -4])
def test_a_cut_image_is_left_out(tmp_path: Path, cut: int, suffix: str) -> None:
    film = write_folder(tmp_path / "f", [f"a{i}.{suffix}" for i in (1, 2, 3)])
    path = tmp_path / f"f/a2.{suffix}"
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.warns(UserWarning, match=rf"1 of 3 images is not whole and left out, a2\.{suffix}"):
        found = instruments.read(tmp_path / "f", fps=1.0)
    assert found.valid.tolist() == [True, False, True]
    np.testing.assert_array_equal(found[2], film[2])
    with pytest.raises(SourceError, match=r"ends|cut off|empty"):
        found[1]


def test_a_tiff_of_several_pages_gives_those_before_the_cut(tmp_path: Path) -> None:
    film = images(4, np.uint16)
    path = tmp_path / "f.tif"
    assert cv2.imwritemulti(str(path), list(film), [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3])
    with pytest.warns(UserWarning, match="the TIFF breaks off before it|cut off"):
        found = instruments.read(path, fps=1.0)
    assert 1 <= found.valid.sum() < 4
    for index in np.flatnonzero(found.valid):
        np.testing.assert_array_equal(found[int(index)], film[index])


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("colours", [3, 4])
def test_colours_that_say_the_same_are_grey_and_others_are_refused(tmp_path: Path, suffix: str, colours: int) -> None:
    (tmp_path / "f").mkdir()
    grey = images(2, np.uint16)
    for i, image in enumerate(grey):
        colour = np.repeat(image[:, :, np.newaxis], colours, axis=2)
        cv2.imwrite(str(tmp_path / f"f/a{i}.{suffix}"), colour)
    found = instruments.read(tmp_path / "f", fps=1.0)
    np.testing.assert_array_equal(np.stack(list(found)), grey)
    colour[3, 4, 0] += 1
    cv2.imwrite(str(tmp_path / f"f/a0.{suffix}"), colour)
    with pytest.raises(SourceError, match="the image is in colour, expected grey"):
        instruments.read(tmp_path / "f", fps=1.0)


@pytest.mark.parametrize("bits", [10, 14])
def test_the_white_level_of_fewer_bits_than_sixteen(tmp_path: Path, bits: int) -> None:
    (tmp_path / "f").mkdir()
    shown = images(2, np.uint16) >> (16 - bits)
    shown[0, 0, :2] = 2**bits - 1, 1
    for shift, white in ((0, 2**bits - 1), (16 - bits, 2**16 - 2 ** (16 - bits))):
        for i, image in enumerate(shown << shift):
            cv2.imwrite(str(tmp_path / f"f/a{i}.tif"), image)
        found = instruments.read(tmp_path / "f", fps=1.0)
        assert found.levels == (0.0, white)
        assert found.roi(slice(2, 4), slice(0, 3)).levels == (0.0, white)


def test_other_bits_and_bare_pixels_are_refused_with_what_to_do(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "f.tif", np.zeros((8, 8), np.uint32))
    with pytest.raises(SourceError, match=r"32 bits per pixel; expected 8 or 16[^$]*of 16 bits"):
        instruments.read(tmp_path / "f.tif", fps=1.0)
    (tmp_path / "f.mraw").write_bytes(np.random.default_rng(0).bytes(999))
    with pytest.raises(SourceError, match=r"\.cihx\) of a \.mraw in its folder, or export the film as TIFF"):
        instruments.read(tmp_path / "f.mraw")


def test_a_number_that_occurs_twice_is_refused(tmp_path: Path) -> None:
    write_folder(tmp_path / "f", ["a9_12bit.tif", "a10_12bit.tif", "a11_12bit.tif", "b10_12bit.tif"])
    with pytest.raises(SourceError, match=r"number 10 occurs twice, also in a10_12bit.tif\n  Put only the images"):
        instruments.read(tmp_path / "f", fps=1000.0)


def test_a_video_without_compression_is_refused_with_what_to_export(tmp_path: Path) -> None:
    """OpenCV 5 ends the program over such a file."""
    layout = struct.pack("<IiiHH4sIiiII", 40, 21, 9, 1, 24, b"\0\0\0\0", 0, 0, 0, 0, 0)
    data = b"RIFF\xff\0\0\0AVI LIST\xf0\0\0\0hdrlstrf" + struct.pack("<I", len(layout)) + layout + bytes(999)
    (tmp_path / "f.avi").write_bytes(data)
    with pytest.raises(SourceError, match=r"without compression is not read\n.*TIFF or PNG"):
        instruments.read(tmp_path / "f.avi", fps=1000.0)


def test_what_is_no_film_is_told_with_what_to_name_instead(tmp_path: Path) -> None:
    write_folder(tmp_path / "out", [])
    write_folder(tmp_path / "out/PNG", ["a1.png"])
    write_folder(tmp_path / "shots", ["a.jpg"])
    (tmp_path / "one.png").write_bytes((tmp_path / "out/PNG/a1.png").read_bytes())
    (tmp_path / "empty.avi").write_bytes(b"")
    for name, told in (
        ("out", "name out/PNG"),
        ("shots", "JPEG images"),
        ("one.png", "name the folder of its images"),
        ("empty.avi", "the file is empty"),
    ):
        with pytest.raises(SourceError, match=told):
            instruments.read(tmp_path / name, fps=1.0)


def test_jpeg_images_are_a_film_to_whoever_gives_a_frame_rate(tmp_path: Path) -> None:
    film = write_folder(tmp_path / "f", ["a8.jpg", "a9.jpg", "a10.jpg"])
    with pytest.raises(SourceError, match="no film") as told:
        instruments.identify(tmp_path / "f")
    assert "with a frame rate" in str(told.value.hint)
    with pytest.warns(UserWarning, match="compression smooths fine detail away"):
        found = instruments.read(tmp_path / "f", fps=1.0)
    assert found.shape == film.shape
    decoded = [cv2.imread(str(tmp_path / f"f/a{i}.jpg"), cv2.IMREAD_GRAYSCALE) for i in (8, 9, 10)]
    np.testing.assert_array_equal([found[i] for i in range(3)], decoded)
    cut = tmp_path / "f/a9.jpg"
    whole = cut.read_bytes()
    for left, what in ((-40, "is cut off: its end is missing"), (30, "ends within its header")):
        cut.write_bytes(whole[:left])
        with pytest.warns(UserWarning, match="smooths"), pytest.warns(IncompleteFilmWarning, match=rf"a9\.jpg.*{what}"):
            assert instruments.read(tmp_path / "f", fps=1.0).valid.tolist() == [True, False, True]


@pytest.mark.parametrize("packing", [1, 5, 8])
@pytest.mark.parametrize("colours", [1, 3])
def test_pages_are_read_in_any_order_and_by_threads(tmp_path: Path, packing: int, colours: int) -> None:
    film = images(9, np.uint8 if colours == 3 else np.uint16)
    pages = [np.stack([p // 2, p, p // 3], axis=2) for p in film] if colours == 3 else list(film)
    assert cv2.imwritemulti(str(tmp_path / "f.tif"), pages, [cv2.IMWRITE_TIFF_COMPRESSION, packing])
    found = instruments.read(tmp_path / "f.tif", fps=100.0, channel="green")
    asked = [8, 0, 4, 4, 1, 7, 3, 8]
    with ThreadPoolExecutor(4) as pool:
        for index, image in zip(asked, pool.map(found.__getitem__, asked), strict=True):
            np.testing.assert_array_equal(image, film[index])
    if colours == 3:
        red = instruments.read(tmp_path / "f.tif", fps=100.0, channel="red")
        np.testing.assert_array_equal(red[5], film[5] // 3)


@pytest.mark.filterwarnings("ignore:.*JPEG images:UserWarning")
@pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "jpg"])
def test_one_channel_of_colour_images_is_read_where_it_is_chosen(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "f").mkdir()
    for number in range(2):
        image = np.zeros((24, 32, 3), np.uint8) + np.array([20, 120 + number, 220], np.uint8)
        assert cv2.imwrite(str(tmp_path / f"f/a{number}.{suffix}"), image)
    with pytest.raises(SourceError, match='channel="green"'):
        instruments.read(tmp_path / "f", fps=1.0)
    for channel, level in (("blue", 20), ("green", 121), ("red", 220)):
        film = instruments.read(tmp_path / "f", fps=1.0, channel=channel)
        assert abs(float(film[1].mean()) - level) <= 3 * (suffix == "jpg")
    with pytest.raises(InputError, match='"red", "green" or "blue"'):
        instruments.read(tmp_path / "f", fps=1.0, channel="grey")


def test_a_palette_that_is_a_grey_ramp_is_grey(tmp_path: Path) -> None:
    film = images(3)
    for number, levels in enumerate(film):
        image = Image.fromarray(255 - levels, "P")
        image.putpalette([255 - i for i in range(256) for _ in range(3)])
        image.save(tmp_path / f"a{number}.tif")
    found = instruments.read(tmp_path, fps=1.0)
    np.testing.assert_array_equal(np.stack(list(found)), film)
    image.putpalette([i * k % 256 for i in range(256) for k in (1, 2, 3)])
    image.save(tmp_path / "a0.tif")
    with pytest.raises(SourceError, match="in colour"):
        instruments.read(tmp_path, fps=1.0)


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["145958120", "145958153", "145958187", "145958220"], "no number in the names counts"),
        (["14-59-58.5", "14-59-59.0", "14-59-59.5", "15-00-00.0"], "occurs twice"),
    ],
)
def test_times_of_a_clock_are_no_numbers_of_frames(tmp_path: Path, names: list[str], told: str) -> None:
    write_folder(tmp_path / "f", [f"cam_{name}.png" for name in names])
    with pytest.raises(SourceError, match=f"{told}[^\\n]*\n.*number the images in the order"):
        instruments.read(tmp_path / "f", fps=1000.0)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


@pytest.mark.filterwarnings("ignore:.*1 of 3 images is:UserWarning")
def test_any_wrong_bit_of_a_png_spoils_this_image_alone(tmp_path: Path, amount: Callable[[int, int], int]) -> None:
    whole = images(3)
    for i, image in enumerate(whole):
        (tmp_path / f"f{i}.png").write_bytes(png(image))
    data, rng, head = png(whole[1]), random.Random(8), 33
    for _ in range(amount(100, 3_000)):
        damaged = bytearray(data)
        damaged[rng.randrange(head, len(data))] ^= 1 << rng.randrange(8)
        (tmp_path / "f1.png").write_bytes(damaged)
        film = instruments.read(tmp_path, fps=100.0)
        assert film.valid.tolist() == [True, False, True]
        view = film.roi(slice(2, 8), slice(0, 4))
        assert view.valid.tolist() == [True, False, True]
        with pytest.raises(SourceError, match=r"f1\.png"):
            film[1]
    assert np.array_equal(film[-1], whole[2])


@pytest.mark.parametrize(
    ("name", "data", "fps", "says"),
    [
        ("first.png", png(images(1)[0]), 1.0, "has no number in its name"),
        ("notes.txt", b"f1.png", 1.0, "holds no image"),
        ("f1.png", png(images(1)[0]), 0.0, "frame rate must be positive"),
        ("f1.png", png(images(1)[0]), float("nan"), "frame rate must be positive"),
        ("f1.tif", b"II*\0\xff\xff\xff\x7f", 1.0, "the TIFF is cut off or damaged"),  # an offset outside of the file
        ("f1.tif", b"II*\0\0\0\0\0", 1.0, "the TIFF is cut off or damaged"),  # no page
        ("f1.tif", b"MM\0+" + bytes(4) + b"\xff" * 8, 1.0, "the TIFF is cut off or damaged"),
    ],
)
def test_what_is_no_film_is_refused(tmp_path: Path, name: str, data: bytes, fps: float, says: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises((SourceError, InputError), match=says):
        instruments.read(tmp_path, fps=fps, instrument="image_stack")


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
    film = instruments.read(video, fps=1000.0, exposure=1e-4)
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
