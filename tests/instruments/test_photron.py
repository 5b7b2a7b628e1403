"""Photron films: header and frames are one film; what does not fit is refused."""

from pathlib import Path

import numpy as np
import pytest

import instruments
from labpipe.errors import SourceError
from labpipe.frames import FrameSource, IncompleteFilmWarning
from pipelines.experiments.shared.film_frames import recorded_on

ROWS, COLUMNS, COUNT = 6, 10, 5
FILM = np.random.default_rng(2).integers(0, 2**12, (COUNT, ROWS, COLUMNS)).astype(np.uint16)
TEXT = """#Camera Information Header
Date : 2018/12/17
Record Rate(fps) : 20000
Shutter Speed(s) : 1/40000
Total Frame : {count}
Start Frame : -2
Image Width : {columns}
Image Height : {rows}
Color Type : {colour}
Color Bit : {bits}
File Format : MRaw
EffectiveBit Depth : 12
EffectiveBit Side : {side}
Comment Text : held : by hand

#Photron Fastcam Viewer Version Information (Resave):
PFV.exe : 3.6.8.1
"""
XML = """\x01\x02<?xml version="1.0" encoding="utf-8"?>
<cih><fileInfo><date>2018/12/17</date></fileInfo><recordInfo><recordRate>20000</recordRate><shutterSpeed>40000</shutterSpeed></recordInfo>
<frameInfo><totalFrame>{count}</totalFrame><startFrame>-2</startFrame></frameInfo>
<imageDataInfo><resolution><width>{columns}</width><height>{rows}</height></resolution>
<colorInfo><type>{colour}</type><bit>{bits}</bit></colorInfo>
<effectiveBit><depth>12</depth><side>{side}</side></effectiveBit></imageDataInfo>
<imageFileInfo><fileFormat>MRAW</fileFormat></imageFileInfo></cih>
\x00\x00"""


def stored(bits: int, side: str) -> bytes:
    if bits == 8:
        return (FILM >> 4).astype(np.uint8).tobytes()
    if bits == 16:
        return (FILM << 4 * (side == "Higher")).astype("<u2").tobytes()
    first, second = FILM.reshape(-1, 2).T
    return np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=1).astype(np.uint8).tobytes()


def write(folder: Path, bits: int = 12, side: str = "Lower", suffix: str = ".cih", **changed: object) -> Path:
    values = {"count": COUNT, "rows": ROWS, "columns": COLUMNS, "bits": bits, "side": side, "colour": "Mono", **changed}
    header = folder / f"drop [1]{suffix}"
    header.write_text((XML if suffix == ".cihx" else TEXT).format(**values), "utf-8")
    header.with_suffix(".mraw").write_bytes(stored(bits, side))
    return header


@pytest.mark.parametrize("suffix", [".cih", ".cihx", ".mraw"])
@pytest.mark.parametrize(
    ("bits", "side", "white"), [(8, "Lower", 255), (12, "Lower", 4095), (16, "Lower", 4095), (16, "Higher", 65520)]
)
def test_pixels_times_and_levels_are_the_cameras(tmp_path: Path, bits: int, side: str, white: int, suffix: str) -> None:
    header = write(tmp_path, bits, side, ".cihx" if suffix == ".cihx" else ".cih")
    film = instruments.read(header.with_suffix(suffix))
    assert isinstance(film, FrameSource)
    assert instruments.identify(header.with_suffix(suffix)) == "photron"
    true = FILM >> 4 if bits == 8 else FILM << 4 * (side == "Higher")
    np.testing.assert_array_equal(np.stack(list(film)), true)
    for rows, columns in ((slice(1, 4), slice(3, 8)), (slice(5, 6), slice(0, 1))):
        np.testing.assert_array_equal(film.roi(rows, columns)[-1], true[-1, rows, columns])
    assert film.levels == (0.0, white)
    np.testing.assert_allclose(film.time, np.arange(-2, 3) / 20e3)
    np.testing.assert_allclose(film.exposure, 25e-6)
    assert film.valid.all()
    assert recorded_on(film) == "2018-12-17"


def test_frames_beyond_the_end_are_left_out(tmp_path: Path) -> None:
    header = write(tmp_path)
    frames = header.with_suffix(".mraw")
    frames.write_bytes(frames.read_bytes()[:-1])
    with pytest.warns(IncompleteFilmWarning, match="1 of 5 frames"):
        film = instruments.read(header)
    assert film.valid.tolist() == [True] * 4 + [False]
    with pytest.raises(SourceError, match="beyond the end"):
        film[4]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"count": 4}, "4 frames of 10 × 6 px"),
        ({"rows": "six"}, "'six'"),
        ({"rows": ""}, "found nothing"),
        ({"columns": 1 << 20}, "from 1 to"),
        ({"bits": 10}, "10 bits"),
        ({"colour": "Bayer"}, "bayer"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_with_a_remedy(
    tmp_path: Path, changed: dict[str, object], words: str
) -> None:
    with pytest.raises(SourceError, match=words) as caught:
        instruments.read(write(tmp_path, **changed))
    assert caught.value.hint


def test_a_missing_half_is_named(tmp_path: Path) -> None:
    header = write(tmp_path)
    header.with_suffix(".mraw").rename(tmp_path / "other.mraw")
    with pytest.raises(SourceError, match="frames are missing"):
        instruments.read(header)
    with pytest.raises(SourceError, match=r"\.cih"):
        instruments.read(tmp_path / "other.mraw")


@pytest.mark.parametrize("suffix", [".cih", ".cihx"])
def test_damaged_headers_never_end_in_another_error(tmp_path: Path, suffix: str) -> None:
    header = write(tmp_path, suffix=suffix)
    data, generator = header.read_bytes(), np.random.default_rng(4)
    for _ in range(100):
        damaged = bytearray(data)
        for place in generator.integers(0, len(data), 3):
            damaged[place] = generator.integers(0, 256)
        header.write_bytes(bytes(damaged[: generator.integers(40, len(data) + 1)]))
        try:
            film = instruments.read(header, instrument="photron")
        except SourceError:
            continue
        assert [film[i].shape for i in np.flatnonzero(film.valid)] == [film.shape[1:]] * int(film.valid.sum())
