"""A small grid of temperature and frequency, and the tables that tests write of it."""

import numpy as np

import instruments
from instruments import tables

FREQUENCY = np.array([0.1, 1.0, 3.1622776602, 10.0])
TEMPERATURE = np.array([20.0, 40.0, 60.0])
F, T = (grid.ravel() for grid in np.broadcast_arrays(FREQUENCY, TEMPERATURE[:, None]))
OMEGA = 2 * np.pi * F
STORAGE = 1.0e9 * (1 + 0.1 * np.log10(F)) * (1 - 0.008 * (T - 20))
LOSS = STORAGE * (0.05 + 0.002 * (T - 20)) / (1 + 0.02 * F)
TAN = LOSS / STORAGE
SIZE, DELTA = np.hypot(STORAGE, LOSS), np.arctan2(LOSS, STORAGE)
ALL = (F, STORAGE / 1e6, LOSS / 1e6, T)


def table(head, *columns, sep=",", decimal=".", form=".14g"):
    """Write lines of headings and rows."""
    rows = (sep.join(format(v, form).replace(".", decimal) for v in row) for row in zip(*columns, strict=True))
    return "\n".join([head, *rows]) + "\n"


def read(folder, text, encoding="utf-8", **options):
    """Read a text, which is recognised by its content unless options say more."""
    path = folder / "anything.txt"
    path.write_bytes(text.encode(encoding))
    if not options:
        assert instruments.identify(path) == "plain_table"
    return tables.read(path, **options)


def assert_is_the_truth(found, *, has_temperature=True):
    order = np.lexsort((found.frequency.values, found.temperature.values)) if has_temperature else slice(None)
    np.testing.assert_allclose(found.frequency.values[order], F, rtol=1e-9)
    np.testing.assert_allclose(found.storage_modulus.values[order], STORAGE, rtol=1e-9)
    np.testing.assert_allclose(found.loss_modulus.values[order], LOSS, rtol=1e-9)
    if has_temperature:
        np.testing.assert_allclose(found.temperature.values[order], T, rtol=0, atol=1e-9)
