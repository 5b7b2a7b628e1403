"""Relaxation tests of rubber under a periodic punch as the virtual rig records them.

One file per depth: the approach, then one ramp and its hold. The stage accelerates and brakes as
real ones do, and the load cell's gain is a little off, within the u of its record.
"""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from pipelines.rig.indentations import Specimen, approach_part, ramp_part, record_parts
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.session_text import write_truth
from pipelines.rig.solids import solid_of, truth_of_solid

TESTER = Tester(force_gain=0.9988, acceleration=0.05)
_PLATEAU = 60.0  # s, the end of the hold over which the truth is averaged
_APART = timedelta(minutes=30)  # between two tests


@dataclass(frozen=True, slots=True)
class Relaxation:
    """The protocol: depths, and how long each is held; a fresh start for every depth."""

    depths: tuple[float, ...] = (0.1e-3, 0.2e-3, 0.3e-3)
    hold: float = 600.0


def write_relaxation(
    folder: Path, name: str, specimen: Specimen, protocol: Relaxation, tester: Tester, seed: int, start: datetime
) -> list[str]:
    """Write one Mach-1 file per depth, and the truth of each; returns the files' names."""
    names = []
    for number, depth in enumerate(protocol.depths):
        parts = [approach_part(), ramp_part(tester, depth, protocol.hold)]
        stem = f"{name}_{depth * 1e6:.0f}um"
        _, force = record_parts(folder, stem, specimen, parts, tester, seed + number, start + number * _APART)
        time = parts[1].time
        late = time >= time[-1] - min(_PLATEAU, 0.1 * protocol.hold)
        solid = solid_of(specimen.material)
        document = {
            "solid": truth_of_solid(solid),
            "surface": specimen.surface,
            "depth": depth,
            "peak_force": float(force.max()),
            "peak_time": float(time[np.argmax(force)]),
            "plateau_force": float(force[late].mean()),
            "end_force": float(force[-1]),
            "force_gain": tester.force_gain,
            "force_offset": tester.force_offset,
            "E_relaxed": solid.relaxed,
            "reduced_modulus": solid.relaxed / (1 - solid.nu**2),
        }
        write_truth(folder, stem, document)
        names.append(f"mach1/{stem}.txt")
    return names
