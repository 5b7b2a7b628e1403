"""Reduce pictures when a page would be too large: noise is expensive in lossless formats."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from labpipe.report._blocks import Block, Details, Gallery, Picture, Section
from labpipe.report._media import mime_type

_QUALITIES = (90, 80, 65)
"""JPEG qualities, tried in turn; at 90 no loss is seen, at 65 edges begin to show it."""
_BASE64 = 4 / 3


def shrunk(sections: Sequence[Section], excess: int) -> tuple[Section, ...]:
    """Return the sections with their PNG pictures as JPEG, as far as a page needs it.

    ``sections``: of one page; ``excess`` [bytes]: how much the page is too large. Returns the same but for pictures;
    those that JPEG does not make smaller, and pictures with transparency, stay as they are. Captions say nothing of it:
    what is shown is the same.
    """
    pictures = list(_pictures(block for section in sections for block in section.blocks))
    made: dict[int, Picture] = {}
    for quality in _QUALITIES:
        made = {id(picture): _as_jpeg(picture, quality) for picture in pictures}
        saved = sum(len(p.data) - len(made[id(p)].data) for p in pictures) * _BASE64
        if saved >= excess:
            break
    return tuple(replace(section, blocks=tuple(_with(block, made) for block in section.blocks)) for section in sections)


def _pictures(blocks: Any) -> Iterator[Picture]:
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Gallery):
            yield from block.frames
        elif isinstance(block, Details):
            yield from _pictures(block.blocks)


def _with(block: Block, made: dict[int, Picture]) -> Block:
    if isinstance(block, Picture):
        return made[id(block)]
    if isinstance(block, Gallery):
        return replace(block, frames=tuple(made[id(frame)] for frame in block.frames))
    if isinstance(block, Details):
        return replace(block, blocks=tuple(_with(inner, made) for inner in block.blocks))
    return block


def _as_jpeg(picture: Picture, quality: int) -> Picture:
    import cv2
    import numpy as np

    if mime_type(picture.data) != "image/png":
        return picture
    image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_UNCHANGED)
    has_alpha = image is not None and image.ndim == 3 and image.shape[2] == 4
    if image is None or image.dtype != np.uint8:
        return picture
    if has_alpha:
        if image[..., 3].min() < 255:
            return picture
        image = image[..., :3]
    # Half the colour resolution would blur a thin coloured circle.
    sampling = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, *sampling]
    data = bytes(cv2.imencode(".jpg", image, options)[1].tobytes())
    return replace(picture, data=data) if len(data) < len(picture.data) else picture
