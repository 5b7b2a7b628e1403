"""Films that were exported as images or as a video, which hold no time and whose intensities are not calibrated."""

import os
from pathlib import Path

import numpy as np

from instruments.images import SUFFIXES, is_tiff
from instruments.images._files import CHANNELS, Channel, ExportedFrames, ImageFiles, folder_images, read_headers
from instruments.images._video import Video
from labpipe.errors import InputError
from labpipe.text import first_bytes

NEEDS_RATE = "Images hold no time: give the camera's frame rate, fps=10000 (in session.toml: frame_rate)."


def read(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    exposure: float | None = None,
    channel: Channel | None = None,
) -> ExportedFrames:
    """Open a folder of images, a multipage TIFF, or a video; SourceError where they are no film of grey images.

    Warns of images that are missing or cut off, and of levels that are not the camera's.

    Parameters
    ----------
    path : path-like
    fps : float [1/s]
        Frame rate of the camera; required, as the files do not know it.
    exposure : float, optional [s]
    channel : {"red", "green", "blue"}, optional
        Of colour images; without it their colours must be equal.

    Returns
    -------
    FrameSource
        Lazy frames; the first frame has time 0.
    """
    path = Path(path)
    if fps is None:
        raise InputError(f"{path}: no frame rate. {NEEDS_RATE}")
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"{path}: the frame rate must be positive, found {fps}")
    if channel is not None and channel not in CHANNELS:
        raise InputError(f'{path}: channel must be "red", "green" or "blue", found "{channel}"')
    film: ExportedFrames
    if path.is_dir():
        headers, numbers = folder_images(path)
        film = ImageFiles(path, headers, channel)
    else:
        is_image = path.suffix.lower() in SUFFIXES or is_tiff(first_bytes(path, 8))
        film = ImageFiles(path, read_headers(path), channel) if is_image else Video(path, channel)
        numbers = np.arange(len(film), dtype=float)
    film.time = (numbers - numbers[0]) / fps
    film.exposure = None if exposure is None else np.full(len(film), exposure)
    first = next((i for i in range(len(film)) if not film.fault(i)), None)
    if first is not None:
        film[first]  # an image in colour, or of an unknown compression, is refused before it is measured
    return film
