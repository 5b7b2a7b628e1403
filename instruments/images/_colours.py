"""The one intensity of an image that may be stored in colours."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from labpipe.errors import SourceError

Channel = Literal["red", "green", "blue"]
CHANNELS: tuple[Channel, ...] = ("blue", "green", "red")
"""In the order in which OpenCV decodes them."""
SMOOTHED = "smooths fine detail away, which no uncertainty here contains"
ROUNDED = 4  # levels by which the compression of videos and JPEG rounds the three colours of grey apart


def one_intensity(image: NDArray[Any], allowed: int, path: Path, name: str, channel: Channel | None) -> NDArray[Any]:
    """Return the intensity of an image: of the channel, or of colours that are equal within so many levels.

    Raises
    ------
    SourceError
        The colours differ and no channel is chosen.
    """
    if image.ndim == 2:
        return image
    if channel is not None:
        return image[:, :, CHANNELS.index(channel)]
    colours = image[:, :, :3].astype(np.int32)
    if int(np.ptp(colours, axis=2).max()) > allowed:
        raise SourceError(
            path,
            f"{name} is in colour, expected grey",
            hint='Choose the channel that is measured, channel="green" (or "red", "blue"; in session.toml: channel = '
            '"green"), or export the film as grey. Green is the finest of most colour sensors.',
        )
    return image[:, :, 1]
