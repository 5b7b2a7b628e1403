"""The compiled loop that counts votes for the centres of rings. Importing it imports numba."""

import math

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import compiled


@compiled(nogil=True)
def count_lines(
    x: Floats,
    y: Floats,
    along_x: Floats,
    along_y: Floats,
    weight: Floats,
    shape: tuple[int, int],
    cell: float,
    margin: float,
    reach: int,
) -> Floats:
    """Add up the weights of the lines that go through each cell, counted once a cell width."""
    rows, columns = shape
    votes = np.zeros((rows, columns))
    for i in range(-reach, reach + 1):
        step = i * cell
        for k in range(x.size):
            column = math.floor((x[k] + step * along_x[k] + margin) / cell)
            row = math.floor((y[k] + step * along_y[k] + margin) / cell)
            if 0 <= column < columns and 0 <= row < rows:
                votes[row, column] += weight[k]
    return votes
