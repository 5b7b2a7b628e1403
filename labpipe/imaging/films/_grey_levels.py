"""Films of real numbers, brought to the range of grey levels of a camera."""

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Integers
from labpipe.frames import FrameSource, ShownFrames

#: Brightest level below which real numbers are no grey levels, as a share of white or in other units, what
#: it becomes, and frames that are asked.
_LEAST, _BRIGHT, _FRAMES = 32.0, 200.0, 3


class ScaledFrames(ShownFrames):
    """A film whose light is multiplied by a factor.

    ``film``: The film as given. ``factor``: Grey levels per unit of its light.
    """

    def __init__(self, film: FrameSource, factor: float) -> None:
        self._film, self._factor = film, factor
        self.time, self.exposure, self.shape, self.valid = film.time, film.exposure, film.shape, film.valid
        self.levels = (factor * film.levels[0], factor * film.levels[1])

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame."""
        return np.asarray(self._film[index] * self._factor)

    def roi(self, rows: slice, columns: slice) -> "ScaledFrames":
        """Return a view of a rectangle."""
        return ScaledFrames(self._film.roi(rows, columns), self._factor)


def in_grey_levels(film: FrameSource) -> FrameSource:
    """Return a film of real numbers, such as shares of white, in levels that compare with a camera's."""
    whole: Integers = np.flatnonzero(film.valid)
    # one pixel tells the type: a film of a camera is not read for it
    if not len(whole) or film.roi(slice(0, 1), slice(0, 1))[int(whole[0])].dtype.kind != "f":
        return film
    chosen = np.unique(whole[np.linspace(0, len(whole) - 1, _FRAMES).astype(int)]).tolist()
    light: list[Floats] = [np.asarray(film[index], float) for index in chosen]
    brightest = max((float(np.abs(image[np.isfinite(image)]).max(initial=0.0)) for image in light), default=0.0)
    return ScaledFrames(film, _BRIGHT / brightest) if 0.0 < brightest < _LEAST else film
