"""Small sound files of every format, made in memory: what the faults are done to."""

from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from instruments import anton_paar, keyence, mach1, phantom

START = datetime(2024, 5, 14, 10, 22, 31)


def mach1_text(rows: int = 12) -> bytes:
    """Two blocks of a mechanical tester."""
    time = np.arange(rows) * 0.01
    common = {"Time, s": time, "Position (z), mm": 1e-3 + 1e-5 * time}
    ramp = mach1.make_block(
        "Stress Relaxation",
        START,
        {**common, "Fz, N": -0.25 - 0.1 * time},
        {"Stage Axis": "Position (z)", "Amplitude, mm": "0.0393"},
        load_cell=mach1.LOAD_CELLS["17N"],
        dividers=(rows // 2, rows),
    )
    wave = mach1.make_block(
        "Sinusoid",
        START,
        {**common, "Fz, gf": 190 + np.sin(40 * time)},
        {"Stage Axis": "Position (z)", "Frequency, Hz": "6.36620"},
    )
    return mach1.encode(mach1.assemble((ramp, wave)))


def keyence_text(rows: int = 12) -> bytes:
    """One storage of a displacement sensor, two outputs."""
    time = np.arange(rows) * 50e-6
    outputs = {1: 2e-3 * np.cos(300 * time), 2: -1e-3 * np.sin(500 * time)}
    made = keyence.encode(outputs, cycle="50 us", start=START, measuring_range=1.99e-3)
    return made.removeprefix(b"\xef\xbb\xbf")


def keyence_readings(readings: np.ndarray, start: datetime = START, **settings: Any) -> xr.Dataset:
    """Readings [m or V] of one output every 50 us, as they are read from a file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(keyence.encode({1: readings}, cycle="50 us", start=start, **settings))
        return keyence.read(path)


def anton_paar_intervals() -> list[Any]:
    """Three intervals of a rheometer, of two tests."""
    make, frequency = anton_paar.make_column, np.array([10.0, 1.0, 0.1])
    return [
        anton_paar.make_interval(
            test,
            "Frequency sweep 1",
            number,
            [
                make("Angular Frequency", "[rad/s]", frequency),
                make("Storage Modulus", "[MPa]", 1e6 * (number + frequency)),
                make("Loss Modulus", "[MPa]", 1e5 * (number + frequency)),
                make("Loss Factor", "[1]", np.full(3, 0.1)),
                make("Temperature", "[°C]", np.full(3, 20.5 + number)),
                make("Torque", "[mN·m]", 1e-4 * frequency),
                make("Status", "", ["TruStrain™", "ME-,taD", "TruStrain™"]),
            ],
        )
        for test, number in (("sample A", 1), ("sample A", 2), ("sample B", 1))
    ]


def anton_paar_text() -> bytes:
    """Their export, UTF-8."""
    made = anton_paar.encode(anton_paar_intervals(), "Sweep | PC, 2/27/2020 | 2")
    return made.decode("utf-16").encode("utf-8")


def film_bytes(
    folder: Path, count: int = 6, rows: int = 4, columns: int = 8, bits: int = 12, time: np.ndarray | None = None
) -> bytes:
    """A film of random pixels at 10,000 frames a second, the trigger at its third frame."""
    images = np.random.default_rng(3).integers(64, 2 ** min(bits, 12), (count, rows, columns))
    kind = np.uint8 if bits == 8 else np.uint16
    recording = phantom.Recording(10_000, 1e-5, bits=bits, first_image=-2)
    time = (np.arange(count) - 2) * 1e-4 if time is None else time
    path = folder / "seed.cine"
    phantom.write(path, images.astype(kind), images.shape, time, recording)
    return path.read_bytes()
