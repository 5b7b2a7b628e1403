"""Dynamic mechanical analysis of the rig's fractional solids as a rheometer exports it, with its true values."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from instruments import anton_paar
from labpipe.arrays import Floats
from pipelines.rig.session_text import dma_name, dma_section, write_truth
from pipelines.rig.solids import SOLIDS, Solid, truth_of_solid


@dataclass(frozen=True, slots=True)
class Protocol:
    """Isothermal sweeps from high to low frequency [Hz], then one temperature sweep.

    ``u_storage`` and ``u_loss`` are the relative noise of the moduli, ``u_scale`` the relative
    scatter of all moduli over specimens, whose dimensions are known so well; ``delay`` [s] is
    that of the phase. ``strain`` is the amplitude of the oscillation; it rests for ``settle`` s at each temperature.
    """

    temperatures: tuple[float, ...] = tuple(np.arange(-40.0, 121.0, 10.0).tolist())
    frequencies: tuple[float, ...] = tuple(np.geomspace(10.0, 0.1, 11).tolist())
    ramp: tuple[float, ...] = tuple(np.arange(-40.0, 121.0, 2.0).tolist())
    ramp_frequency: float = 1.0
    u_storage: float = 0.01
    u_loss: float = 0.02
    u_temperature: float = 0.03
    offset_temperature: float = 0.2
    u_scale: float = 0.0
    delay: float = 0.0
    strain: float = 2e-4
    settle: float = 300.0


CAMPAIGN = Protocol(u_scale=0.01, delay=20e-6)
"""What the campaign's rheometer does to a modulus."""


def write_dma(folder: Path, name: str, solid: Solid, protocol: Protocol, seed: int) -> str:
    """Write one export and its truth; returns the export's name in the folder."""
    generator = np.random.default_rng(seed)
    scale = float(np.exp(protocol.u_scale * generator.standard_normal())) if protocol.u_scale else 1.0
    is_torsion = solid.mode == "torsion"
    kind, factor = ("Shear", 2 * (1 + solid.nu)) if is_torsion else ("Extensional", 1.0)
    make = anton_paar.make_column

    def columns(time: Floats, frequency: Floats, temperature: Floats) -> list[anton_paar.Column]:
        """Make the columns of one table: the moduli with multiplicative noise."""
        phase = np.exp(2j * np.pi * frequency * protocol.delay)
        true = scale * phase * solid.modulus(frequency, temperature) / factor
        storage = true.real * np.exp(protocol.u_storage * generator.standard_normal(time.size))
        loss = true.imag * np.exp(protocol.u_loss * generator.standard_normal(time.size))
        shown = temperature + protocol.u_temperature * generator.standard_normal(time.size)
        strain = np.full(time.size, protocol.strain)
        return [
            make("Time", "[s]", time),
            make("Temperature", "[°C]", np.round(shown, 2)),
            make("Angular Frequency", "[rad/s]", 2 * np.pi * frequency),
            make("Storage Modulus", "[MPa]", storage),
            make("Loss Modulus", "[MPa]", loss),
            make("Loss Factor", "[1]", loss / storage),
            make(f"{kind} Strain", "[%]", strain),
            make(f"{kind} Stress", "[kPa]", strain * np.hypot(storage, loss)),
            make("Status", "", ["Dy_auto"] * time.size),
        ]

    clock, intervals = 0.0, []
    frequency = np.asarray(protocol.frequencies)
    for number, temperature in enumerate(protocol.temperatures, 1):
        time = np.asarray(clock + protocol.settle + np.cumsum(3.0 / frequency), dtype=np.float64)
        clock = float(time[-1])
        table = columns(time, frequency, np.full(frequency.size, temperature + protocol.offset_temperature))
        intervals.append(anton_paar.make_interval(f"{name} (synthetic)", "Frequency sweeps", number, table))
    T = np.asarray(protocol.ramp)
    table = columns(30.0 * np.arange(1.0, T.size + 1.0), np.full(T.size, protocol.ramp_frequency), T)
    intervals.append(anton_paar.make_interval(f"{name} ramp (synthetic)", "Temperature sweep 1", 1, table))
    project = f"{name}, SYNTHETIC, layout assumed | the virtual rig, 5/14/2024 | 1"
    anton_paar.write(folder / f"dma/{name}.csv", intervals, project, 5)
    T = np.asarray(protocol.temperatures) + protocol.offset_temperature
    shift = solid.log10_aT(T)
    low, high = (np.log10(g(protocol.frequencies)) + g(shift) for g in (min, max))
    reduced = np.logspace(low, high, 60)
    curve = solid.modulus(reduced, np.full(reduced.size, solid.T_ref))
    truth = truth_of_solid(solid) | {
        "mode": solid.mode,
        "T_ref": solid.T_ref,
        "temperature": T.tolist(),
        "log10_aT": shift.tolist(),
        "frequency": reduced.tolist(),
        "storage": curve.real.tolist(),
        "loss": curve.imag.tolist(),
        "u_storage": protocol.u_storage,
        "u_loss": protocol.u_loss,
        "delay": protocol.delay,
        "law": {"energy": solid.energy, "kink": min(solid.kink, 1e3), "C1": solid.C1, "C2": solid.C2},
        "softening": solid.softening,
        "is_entropic": solid.is_entropic,
        "scale": scale,
    }
    write_truth(folder, name, truth)
    return f"dma/{name}.csv"


def sweeps(folder: Path, *of: str, protocol: Protocol = CAMPAIGN, seed: int = 0) -> str:
    """Write the rheometer's exports of materials; returns their sections."""
    sections = ""
    for material in of:
        name, solid = dma_name(material), SOLIDS[material]
        export = write_dma(folder, name, solid, protocol, seed + 500 + list(SOLIDS).index(material))
        sections += dma_section(name, export, solid)
    return sections
