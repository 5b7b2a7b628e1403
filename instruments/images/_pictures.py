"""What films of exported images are decoded from: the contract, and the one intensity of grey colours."""

from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags
from labpipe.errors import SourceError

Channel = Literal["red", "green", "blue"]
CHANNELS: tuple[Channel, ...] = ("blue", "green", "red")
"""In the order in which OpenCV decodes them."""
SMOOTHED = "smooths fine detail away, which no uncertainty here contains"
ROUNDED = 4  # levels by which the compression of videos and JPEG rounds the three colours of grey apart


class Pictures(Protocol):
    """Whole images of one size, one at a time."""

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    def levels(self) -> tuple[float, float]:
        """Black and white level."""

    @property
    def valid(self) -> Flags:
        """Which images can be decoded; shape (image,)."""

    def __len__(self) -> int:
        """Return the number of images."""

    def fault(self, index: int) -> str:
        """Say why an image cannot be decoded, or ""."""

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one image; raises SourceError where it cannot be."""


def one_intensity(image: NDArray[Any], allowed: int, path: Path, what: str, channel: Channel | None) -> NDArray[Any]:
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
            f"{what} is in colour, expected grey",
            hint='Choose the channel that is measured, channel="green" (or "red", "blue"; in session.toml: channel = '
            '"green"), or export the film as grey. Green is the finest of most colour sensors.',
        )
    return image[:, :, 1]
