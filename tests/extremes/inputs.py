"""Random generators of extreme cases."""

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials import Prony

Random = np.random.Generator


def extreme_material(random: Random, most_terms: int = 60) -> Prony:
    """Draw 1 kPa to 1 TPa, 1e-12 to 1e6 s in one material, ratios to 1e4, any Poisson's ratio."""
    terms = int(random.integers(0, most_terms + 1))
    relaxed, ratio = 10 ** random.uniform(3, 12), 10 ** random.uniform(0.01, 4)
    nu = float(random.choice([0.0, 0.4999, random.uniform(0.0, 0.5)]))
    if terms == 0:
        return Prony(relaxed, [], [], nu=nu)
    share = random.dirichlet(np.ones(terms)) * (1.0 - 1.0 / ratio) / relaxed
    return Prony.from_creep(relaxed, share, 10 ** random.uniform(-12, 6, terms), nu=nu)


def extreme_times(random: Random, count: int) -> Floats:
    """Draw steps of 1e-9 to 1e3 s in one history, some of no length."""
    steps = 10 ** random.uniform(-9, 3, count)
    steps[random.random(count) < 0.2] = 0.0
    return np.concatenate([[0.0], np.cumsum(steps)])


def below_zero(values: Floats) -> float:
    """Infinite when any value is negative or no number, else 0."""
    return 0.0 if np.all(values >= 0.0) else np.inf


def laid_out(random: Random, values: Floats, *, is_single: bool = False) -> Floats:
    """Copy into a memory layout that a caller may have: strided, reversed, read-only, swapped.

    With ``is_single`` the numbers are rounded to float32 and come in that type.
    """
    kind = np.float32 if is_single else np.float64
    if random.random() < 0.2:
        kind = np.dtype(kind).newbyteorder(">")  # type: ignore[assignment]
    layout = str(random.choice(["plain", "strided", "reversed"]))
    if layout == "strided":
        room = np.full((*values.shape[:-1], 3 * values.shape[-1]), np.nan, kind)
        laid = room[..., 1::3]
    elif layout == "reversed":
        laid = np.empty(values.shape, kind)[..., ::-1]
    else:
        laid = np.empty(values.shape, kind)
    laid[...] = values
    # What is written to a read-only array raises, so that no input is changed unseen.
    laid.setflags(write=False)
    return laid


def with_gaps(random: Random, values: Floats) -> Floats:
    """Lose bursts of readings, at most a third of them in all; half of the records lose none."""
    if random.random() < 0.5:
        return values
    gapped = values.copy()
    for _ in range(int(random.integers(1, 4))):
        length = int(random.integers(1, max(2, values.size // 9)))
        begin = int(random.integers(0, values.size))
        gapped[begin : begin + length] = np.nan
    gapped.setflags(write=False)
    return gapped
