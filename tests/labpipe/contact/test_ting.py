"""The Lee-Radok and Ting oracle against 14-digit tables."""

import numpy as np
import pytest

from labpipe.materials import Prony
from tests.labpipe.contact.ting_solution import ting

# Triangle t, 2 − t; F in units of (4/3)√R, and a²/R.
SOFT = {
    0.1: (0.030516173064619, 0.1),
    0.5: (0.29808021331168, 0.5),
    1.0: (0.72359266566776, 1.0),
    1.1: (0.52472764119916, 0.89021881612432),
    1.2: (0.35263839545418, 0.75717533691364),
    1.4: (0.092806179861841, 0.38948330058915),
}
HALF = {
    0.1: (0.030427047013755, 0.1),
    0.5: (0.29926186268327, 0.5),
    1.0: (0.75500223601899, 1.0),
    1.1: (0.56974199509347, 0.89012512192216),
    1.2: (0.41381368030125, 0.76206873618999),
    1.4: (0.1796082976273, 0.47129135974076),
}
TABLES = {
    "soft": (Prony(0.1, [0.9], [1.0], nu=0.0), SOFT, 1.542098051836172),
    "half": (Prony(0.5, [0.5], [0.5], nu=0.0), HALF, 1.720621162508155),
}


@pytest.mark.parametrize("name", TABLES)
def test_ting_reproduces_the_triangle_to_all_digits(name) -> None:
    material, table, release = TABLES[name]
    time = np.array([0.0, *table, release + 1e-9, 2.0])
    found = ting(material, 1.0, time, np.where(time <= 1.0, time, 2.0 - time))
    force = np.array([row[0] for row in table.values()])
    square = np.array([row[1] for row in table.values()])
    assert found.force[1:-2] / (4 / 3) == pytest.approx(force, rel=1e-12)
    assert found.contact_radius[1:-2] ** 2 == pytest.approx(square, rel=1e-12)
    assert found.force[-2:] == pytest.approx([0.0, 0.0], abs=1e-15)
