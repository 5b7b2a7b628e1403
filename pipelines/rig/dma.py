"""Dynamic mechanical analysis as the virtual rig exports it, with its true values.

The materials are fractional elements (Havriliak & Negami, Polymer 8 (1967) 161,
doi:10.1016/0032-3861(67)90021-3), which no finite sum of exponentials equals; the analysis fits
such sums, so it cannot be right by construction. Nothing here asks :mod:`labpipe.materials`.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from instruments import anton_paar
from labpipe import files
from labpipe.arrays import Floats

_GAS_LN10 = 8.314462618 * np.log(10.0)  # J/(mol K)
_ZERO_CELSIUS = 273.15
_DIGITS = 5  # of the export
_RELATIVE_STRAIN = 2e-4  # amplitude of the oscillation
_SETTLE = 300.0  # s at a new temperature before its sweep begins


@dataclass(frozen=True, slots=True)
class Element:
    """One Havriliak–Negami relaxation: strength [Pa], time [s] at the reference, exponents."""

    strength: float
    time: float
    width: float
    skew: float = 1.0


@dataclass(frozen=True, slots=True)
class Solid:
    """A thermorheologically simple solid in tension.

    ``energy`` [J/mol] is the Arrhenius slope below ``kink`` [degC]; above it the WLF constants
    ``C1`` and ``C2`` [K] hold about the kink. ``is_entropic`` makes the modulus rise with the
    absolute temperature. ``mode`` and ``nu`` say how the rig loads it.
    """

    elements: tuple[Element, ...]
    relaxed: float
    nu: float
    energy: float = 0.0
    kink: float = np.inf
    C1: float = 0.0
    C2: float = 1.0
    T_ref: float = 20.0
    is_entropic: bool = False
    mode: Literal["tension", "torsion"] = "tension"

    def log10_aT(self, temperature: ArrayLike) -> Floats:
        """Return log10 of the horizontal shift at temperatures in °C; zero at the reference."""
        T = np.asarray(temperature, dtype=float)
        return self._from_kink(T) - self._from_kink(np.asarray(self.T_ref))

    def _from_kink(self, T: Floats) -> Floats:
        if not np.isfinite(self.kink):
            return np.asarray(self.energy / _GAS_LN10 / (T + _ZERO_CELSIUS))
        cold = np.minimum(T, self.kink)
        below = self.energy / _GAS_LN10 * (1 / (cold + _ZERO_CELSIUS) - 1 / (self.kink + _ZERO_CELSIUS))
        warm = np.maximum(T - self.kink, 0.0)
        return np.asarray(below - self.C1 * warm / (self.C2 + warm))

    def modulus(self, frequency: ArrayLike, temperature: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex tension modulus at frequencies in Hz and temperatures in °C."""
        T = np.asarray(temperature, dtype=float)
        omega = 2 * np.pi * np.asarray(frequency, dtype=float) * 10.0 ** self.log10_aT(T)
        total = np.full(np.shape(omega), self.relaxed, dtype=complex)
        for e in self.elements:
            total += e.strength * (1 - (1 + (1j * omega * e.time) ** e.width) ** -e.skew)
        vertical = (T + _ZERO_CELSIUS) / (self.T_ref + _ZERO_CELSIUS) if self.is_entropic else 1.0
        return np.asarray(total * vertical)


#: Five solids near the library's moduli; none is a measurement.
SOLIDS: dict[str, Solid] = {
    "nbr": Solid(
        (Element(1.5e9, 2e-8, 0.62, 0.55), Element(4e6, 3.0, 0.45)),
        7.6e6,
        0.49,
        kink=-60.0,
        C1=23.0,
        C2=60.0,
        is_entropic=True,
        mode="torsion",
    ),
    "acrylic": Solid(
        (Element(2.4e9, 2e4, 0.6, 0.6), Element(2.4e9, 0.02, 0.32)),
        6e6,
        0.35,
        energy=80e3,
        kink=100.0,
        C1=13.0,
        C2=55.0,
    ),
    "peek": Solid((Element(1.0e9, 1.0, 0.2),), 3.7e9, 0.38, energy=60e3),
    "nylon": Solid((Element(2.4e9, 2.0, 0.3),), 0.6e9, 0.40, energy=90e3),
    "ptfe": Solid((Element(1.6e9, 4e-4, 0.42, 0.9),), 0.35e9, 0.46, energy=100e3),
}


@dataclass(frozen=True, slots=True)
class Protocol:
    """Isothermal sweeps from high to low frequency [Hz], then one temperature sweep.

    ``u_storage`` and ``u_loss`` are the relative noise of the moduli.
    """

    temperatures: tuple[float, ...] = tuple(np.arange(-40.0, 121.0, 10.0).tolist())
    frequencies: tuple[float, ...] = tuple(np.geomspace(10.0, 0.1, 11).tolist())
    ramp: tuple[float, ...] = tuple(np.arange(-40.0, 121.0, 2.0).tolist())
    ramp_frequency: float = 1.0
    u_storage: float = 0.01
    u_loss: float = 0.02
    u_temperature: float = 0.03
    offset_temperature: float = 0.2


def write_dma(folder: Path, name: str, solid: Solid, protocol: Protocol, seed: int) -> str:
    """Write one export and the truth beside it; returns the export's name in the folder."""
    generator = np.random.default_rng(seed)
    clock = 0.0
    intervals = []
    for number, temperature in enumerate(protocol.temperatures, 1):
        frequency = np.asarray(protocol.frequencies)
        T = np.full(frequency.size, temperature + protocol.offset_temperature)
        clock += _SETTLE
        time = np.asarray(clock + np.cumsum(3.0 / frequency), dtype=np.float64)
        clock = float(time[-1])
        columns = _columns(solid, protocol, generator, time, frequency, T)
        intervals.append(anton_paar.make_interval(f"{name} (synthetic)", "Frequency sweeps", number, columns))
    T = np.asarray(protocol.ramp)
    columns = _columns(
        solid,
        protocol,
        generator,
        30.0 * np.arange(1.0, T.size + 1.0, dtype=np.float64),
        np.full(T.size, protocol.ramp_frequency),
        T,
    )
    intervals.append(anton_paar.make_interval(f"{name} ramp (synthetic)", "Temperature sweep 1", 1, columns))
    project = f"{name}, SYNTHETIC, layout assumed | the virtual rig, 5/14/2024 | 1"
    export = anton_paar.assemble(intervals, project=project)
    anton_paar.write(folder / f"dma/{name}.csv", export, digits=_DIGITS)
    text = json.dumps(_truth(solid, protocol), indent=1) + "\n"
    files.write_text(folder / f"truth/{name}.json", text)
    return f"dma/{name}.csv"


def _columns(
    solid: Solid,
    protocol: Protocol,
    generator: np.random.Generator,
    time: Floats,
    frequency: Floats,
    temperature: Floats,
) -> list[anton_paar.Column]:
    """Make the columns of one table: the moduli with multiplicative noise."""
    true = solid.modulus(frequency, temperature)
    factor = 2 * (1 + solid.nu) if solid.mode == "torsion" else 1.0
    storage = true.real / factor * np.exp(protocol.u_storage * generator.standard_normal(time.size))
    loss = true.imag / factor * np.exp(protocol.u_loss * generator.standard_normal(time.size))
    shown = temperature + protocol.u_temperature * generator.standard_normal(time.size)
    kind = "Shear" if solid.mode == "torsion" else "Extensional"
    strain = np.full(time.size, _RELATIVE_STRAIN)
    make = anton_paar.make_column
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


def _truth(solid: Solid, protocol: Protocol) -> dict[str, Any]:
    temperature = np.asarray(protocol.temperatures) + protocol.offset_temperature
    shift = solid.log10_aT(temperature)
    low = np.log10(min(protocol.frequencies)) + shift.min()
    high = np.log10(max(protocol.frequencies)) + shift.max()
    frequency = np.logspace(low, high, 60)
    curve = solid.modulus(frequency, np.full(frequency.size, solid.T_ref))
    return {
        "synthetic": True,
        "elements": [
            {"strength": e.strength, "time": e.time, "width": e.width, "skew": e.skew} for e in solid.elements
        ],
        "relaxed": solid.relaxed,
        "nu": solid.nu,
        "mode": solid.mode,
        "T_ref": solid.T_ref,
        "temperature": temperature.tolist(),
        "log10_aT": shift.tolist(),
        "frequency": frequency.tolist(),
        "storage": curve.real.tolist(),
        "loss": curve.imag.tolist(),
        "u_storage": protocol.u_storage,
        "u_loss": protocol.u_loss,
    }
