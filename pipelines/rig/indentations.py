"""Indentations of rubber by a periodic punch as the virtual rig records them, with true values.

A harmonic file holds the whole history of one specimen: the approach, the ramp and the hold, and then one Sinusoid
block per frequency. Relaxations have one file per depth: the approach, then one ramp and its hold. The true force of a
whole history comes from :mod:`pipelines.rig.reference_indentation`; nothing is computed block by block.
"""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from instruments import mach1
from instruments.mach1 import LoadCell, assemble, make_block
from labpipe.arrays import Floats
from pipelines.rig.apparatus import PUNCH
from pipelines.rig.mach1_tester import OVERSAMPLING, RATE, Tester, approach, oscillation, ramp, record
from pipelines.rig.reference_indentation import reference_indentation
from pipelines.rig.session_text import from_library, section, write_truth
from pipelines.rig.solids import Truth, solid_of, truth_of_solid

CELL = LoadCell("250N SN:0000000 (synthetic)", "Multiple-axis", 1.0, 0.0, steps={"Fz, N": 0.0125})
TESTER = Tester(force_gain=0.9988, acceleration=0.05)
"""Its stage accelerates and brakes as real ones do; the cell's gain is off within the u of its record."""


@dataclass(frozen=True, slots=True)
class Specimen:
    """The punch and the solid under it; lengths in m.

    ``depth`` is the length of one tip; ``surface`` the stage position of first touch.
    """

    material: Truth
    tip_radius: float = PUNCH.radius
    period: float = PUNCH.period
    depth: float = PUNCH.depth
    tips: int = PUNCH.tips
    surface: float = 12.3456e-3


@dataclass(frozen=True, slots=True)
class Harmonic:
    """The protocol: mean indentation, hold, then one oscillation per frequency."""

    mean: float = 0.1e-3
    amplitude: float = 0.01e-3
    hold: float = 600.0
    frequencies: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0, 2.0)
    cycles: int = 12
    rest: float = 0.4


@dataclass(frozen=True, slots=True)
class Relaxation:
    """The protocol: depths in m, and how long each is held in s; a fresh start for every depth, ``apart`` min.

    The true plateau is the mean over ``plateau`` s at the end of the hold.
    """

    depths: tuple[float, ...] = (0.1e-3, 0.2e-3, 0.3e-3)
    hold: float = 600.0
    plateau: float = 60.0
    apart: float = 30.0


@dataclass(frozen=True, slots=True)
class Part:
    """One block before it is written: its function, fine history and parameters."""

    function: str
    time: Floats
    displacement: Floats
    parameters: dict[str, str]
    frequency: float = 0.0


def approach_part(tester: Tester) -> Part:
    """Return the approach from above the surface to slight contact."""
    settings = {
        "Stage Axis": "Position (z)",
        "Load Cell Axis": "Fz",
        "Direction": "Positive",
        "Contact Criteria, N": "0.0500",
        "Stage Velocity, mm/s": "0.0500",
        "Stage Limit, mm": "5.0000",
        "Stage Repositioning": "None",
        "Offset, mm": "0.0000",
    }
    return Part("Find Contact", *approach(-tester.air, tester.touch, tester.approach_speed), settings)


def ramp_part(tester: Tester, depth: float, hold: float) -> Part:
    """Return the ramp from slight contact to a depth, and the hold there."""
    settings = {
        "Stage Axis": "Position (z)",
        "Load Cell Axis": "Fz",
        "Amplitude, mm": f"{(depth - tester.touch) * 1e3:.4f}",
        "Velocity, mm/s": "1.0000",
        "Number of Ramp": "1",
        "Stop based on": "Fixed Relaxation Time",
        "Fixed Relaxation Time, s": f"{hold:.0f}",
    }
    return Part("Stress Relaxation", *ramp(tester, tester.touch, depth, hold), settings)


def write_harmonic(
    folder: Path, name: str, specimen: Specimen, protocol: Harmonic, tester: Tester, seed: int, start: datetime
) -> None:
    """Write one Mach-1 file and its truth."""
    parts = [approach_part(tester), ramp_part(tester, protocol.mean, protocol.hold)]
    for frequency in protocol.frequencies:
        asked = protocol.mean, protocol.amplitude, frequency, protocol.cycles, protocol.rest
        time, displacement, real = oscillation(tester, *asked)
        settings = {
            "Stage Axis": "Position (z)",
            "Amplitude, mm": f"{protocol.amplitude * 1e3:.4f}",
            "Frequency, Hz": f"{frequency:.5f}",
            "Number of Cycles": str(protocol.cycles),
        }
        parts.append(Part("Sinusoid", time, displacement, settings, real))
    pieces = record_parts(folder, name, specimen, parts, tester, seed, start)
    document: dict[str, Any] = {
        "solid": truth_of_solid(solid_of(specimen.material)),
        "surface": specimen.surface,
        "mean": protocol.mean,
        "peak_force": float(pieces[1].max()),
        "plateau_force": float(pieces[1][-1]),
        "force_offset": tester.force_offset,
        "oscillations": [
            _truth_of(part, piece, protocol, tester)
            for part, piece in zip(parts, pieces, strict=True)
            if part.frequency
        ],
    }
    write_truth(folder, name, document)


def write_relaxation(
    folder: Path, name: str, specimen: Specimen, protocol: Relaxation, tester: Tester, seed: int, start: datetime
) -> list[str]:
    """Write one Mach-1 file per depth, and the truth of each; returns the files' names."""
    names = []
    for number, depth in enumerate(protocol.depths):
        parts = [approach_part(tester), ramp_part(tester, depth, protocol.hold)]
        stem, begun = f"{name}_{depth * 1e6:.0f}um", start + timedelta(minutes=number * protocol.apart)
        _, force = record_parts(folder, stem, specimen, parts, tester, seed + number, begun)
        time = parts[1].time
        late = time >= time[-1] - min(protocol.plateau, 0.1 * protocol.hold)
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


def record_parts(
    folder: Path, name: str, specimen: Specimen, parts: list[Part], tester: Tester, seed: int, start: datetime
) -> list[Floats]:
    """Write the blocks of one file as the instrument records them; returns their true forces."""
    generator = np.random.default_rng(seed)
    begins = np.cumsum([0.0] + [p.time[-1] + tester.settle for p in parts[:-1]])
    ends = np.cumsum([p.time.size for p in parts])
    pieces = np.split(_force(specimen, parts, begins), ends[:-1])
    blocks = []
    for part, piece, begin in zip(parts, pieces, begins.tolist(), strict=True):
        force = record(tester, piece, generator)
        columns = {
            "Time, s": np.arange(force.size) / RATE,
            "Position (z), mm": specimen.surface + part.displacement[::OVERSAMPLING],
            "Fz, N": -force,  # a six-axis cell counts compression negative
        }
        dividers = (force.size,) if part.function == "Stress Relaxation" else ()
        given = part.function, start + timedelta(seconds=begin), columns, part.parameters
        blocks.append(make_block(*given, load_cell=CELL, dividers=dividers))
    mach1.write(folder / f"mach1/{name}.txt", assemble(blocks))
    return pieces


def _force(specimen: Specimen, parts: list[Part], begins: Floats, dense: float = 1.0, thinning: int = 50) -> Floats:
    """Return the true force over all blocks, at every fine point.

    Where the stage rests it is smooth in log time: from ``dense`` s after a motion on one point in ``thinning`` is
    computed.
    """
    time = np.concatenate([b + p.time for b, p in zip(begins, parts, strict=True)])
    displacement = np.concatenate([p.displacement for p in parts])
    # of an oscillation 400 points a cycle are computed: a line between two misses 3e-5 of the amplitude
    every = [max(1, int(RATE * OVERSAMPLING / (400 * p.frequency))) if p.frequency else 1 for p in parts]
    strides = [np.full(p.time.size, stride) for p, stride in zip(parts, every, strict=True)]
    moves, number = np.flatnonzero(np.diff(displacement) != 0), np.arange(time.size)
    since, last = np.full(time.size, np.inf), np.searchsorted(moves, number, side="right") - 1
    since[last >= 0] = time[last >= 0] - time[moves[last[last >= 0]] + 1]
    keep = (since < dense) & (number % np.concatenate(strides) == 0) | (number % thinning == 0)
    # the last fine point before a motion begins must stay, or the ramp would start early
    keep[moves[np.diff(moves, prepend=-2) > 1]] = True
    keep[[0, -1]] = True
    kept = np.flatnonzero(keep)
    force, _ = reference_indentation(
        solid_of(specimen.material),
        tip_radius=specimen.tip_radius,
        period=specimen.period,
        depth=specimen.depth * specimen.tips,
        time=time[kept],
        displacement=displacement[kept],
    )
    return np.interp(time, time[kept], force)


def _truth_of(part: Part, force: Floats, protocol: Harmonic, tester: Tester) -> dict[str, float]:
    """Return amplitude, work and complex stiffness of the second half of an oscillation.

    The mean force still relaxes meanwhile; a parabola in time takes that out.
    """
    period = 1 / part.frequency
    end = protocol.rest + protocol.cycles * period
    grid = np.linspace(end - (protocol.cycles // 2) * period, end, 20001)
    since = (grid - end) * part.frequency
    angle = 2 * np.pi * since
    design = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(since), since, since**2])

    def phasor(values: Floats) -> complex:
        sine, cosine, *_ = np.linalg.lstsq(design, values, rcond=None)[0]
        return complex(sine, cosine)

    x = phasor(np.interp(grid, part.time, part.displacement))
    f = phasor(np.interp(grid, part.time, force))
    stiffness = f / x
    amplitude = protocol.amplitude * (1 + tester.amplitude_error)
    return {
        "frequency": part.frequency,
        "amplitude": amplitude,
        "force_amplitude": abs(f),
        "storage_stiffness": stiffness.real,
        "loss_stiffness": stiffness.imag,
        "work_per_cycle": float(np.pi * amplitude**2 * stiffness.imag),
        "contact_loss": float(np.mean(np.interp(grid, part.time, force) <= 0.0)),
    }


def punch_section(name: str, specimen: Specimen, source: str, *, is_calibrated: bool = True) -> str:
    """Return the tables of punch, substrate and model of an indentation, and of the load cell where it is calibrated.

    Without a calibration lengths are stated without their uncertainty too.
    """
    u_tip, u_depth = (" ± 0.002", " ± 0.006") if is_calibrated else ("", "")
    given = {"u_tip": u_tip, "u_depth": u_depth, "source": source or from_library("nbr")}
    return section("punch", name=name, specimen=specimen, is_calibrated=is_calibrated, **given)


def relaxation_section(name: str, mach1: list[str], specimen: Specimen, source: str = "") -> str:
    """Return the tables of relaxation tests in session.toml."""
    return section("relaxation", name=name, mach1=mach1) + punch_section(name, specimen, source)


def oscillation_section(name: str, specimen: Specimen, source: str = "", *, is_calibrated: bool = True) -> str:
    """Return the tables of a harmonic indentation, by default with a calibrated load cell."""
    head = section("harmonic", name=name, is_calibrated=is_calibrated)
    return head + punch_section(name, specimen, source, is_calibrated=is_calibrated)
