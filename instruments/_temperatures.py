"""Temperatures as files give them, kept in degC."""

from pathlib import Path

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import SourceError
from labpipe.units import ZERO_CELSIUS


def celsius(values: Floats, si: str, *, path: Path, line: int, header: str, stated: str) -> Floats:
    """Convert a column in degC, K or degF to degC.

    Raises
    ------
    SourceError
        It holds a temperature below absolute zero: the unit is that of another scale.
    """
    scales = {"K": values - ZERO_CELSIUS, "degF": (values - 32.0) * 5.0 / 9.0}
    found = scales.get(si, values)
    if (found < -ZERO_CELSIUS).any():
        said = f'{header} is in "{stated}" and holds {np.nanmin(values):g}, below absolute zero'
        raise SourceError(path, said, line=line, hint="Correct the row of units, or export again.")
    return found
