"""Results that others published, each beside the one that labpipe gives for the same inputs.

Only public functions are used. Where a source states no uncertainty, that of its last printed digit is taken.
"""

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.stats import chi2

import instruments
from labpipe.contact import drop, indent
from labpipe.contact.sphere import hertz
from labpipe.imaging import track
from labpipe.materials import MasterCurve, Prony, master_curve
from labpipe.report import number, plus_minus
from labpipe.signals import active_window, common_fit

FOLDER = Path(__file__).parent
SAMPLES = FOLDER.parents[1] / "../shared/samples"
ROUNDED = 12**-0.5  # standard uncertainty of a rounded number, in units of its last digit


def shown(value: float, u: float, other_u: float) -> str:
    """Write a number with its uncertainty, unless that of what it is compared with is a hundred times as large."""
    return plus_minus(value, u) if u > 0.01 * other_u else number(value, 5)


class Value(NamedTuple):
    """One number as published and as labpipe gives it, each with its standard uncertainty."""

    published: float
    u_published: float
    found: float
    u_found: float

    @property
    def deviation(self) -> float:
        return (self.found - self.published) / float(np.hypot(self.u_published, self.u_found))


@dataclass(frozen=True)
class PublishedCase:
    """A published table, figure or data set; the docstring of ``values`` says how its numbers came here."""

    quantity: str  # of the first value
    source: str
    inputs: str
    remark: str = ""  # why they differ, where they do
    sample: str = ""  # a file below SAMPLES that is needed
    is_long: bool = False
    values: Callable[[], list[Value]] = list

    def __call__(self, values: Callable[[], list[Value]]) -> Callable[[], list[Value]]:
        CASES.append(replace(self, values=values))
        return values

    @property
    def name(self) -> str:
        return f"{self.quantity}, {self.source}"

    @property
    def is_present(self) -> bool:
        return not self.sample or (SAMPLES / self.sample).exists()

    def row(self, values: list[Value]) -> str:
        """Return the row of the page: the first value, the rms of all deviations, the verdict at 95 %."""
        deviations = np.array([value.deviation for value in values])
        square, first = np.mean(deviations**2), values[0]
        agrees = square * deviations.size <= chi2.ppf(0.95, deviations.size)
        pair = shown(*first[:2], first.u_found), shown(*first[2:], first.u_published)
        verdict = "agrees" if agrees else f"differs: {self.remark}"
        return "|".join(["", self.name, self.inputs, *pair, f"{square**0.5:.1f} ({deviations.size})", verdict, ""])


CASES: list[PublishedCase] = []


def quiet_curve(sweeps: xr.Dataset, T_ref: float, **options: object) -> MasterCurve:
    """Return the master curve of measured sweeps, whose doubts are in its uncertainties."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return master_curve(sweeps, T_ref=T_ref, **options)


def step_tests(name: str, column: str, to_si: float, seconds: float) -> xr.Dataset:
    """Return relaxation or creep tests at several temperatures as the readings of one export."""
    temperature, time, response = np.loadtxt(FOLDER / name, delimiter=",", unpack=True)
    rows = [{"rows": int(np.sum(temperature == T))} for T in dict.fromkeys(temperature)]
    columns = {"interval_time": time * seconds, column: response * to_si, "temperature": temperature}
    return xr.Dataset({key: ("sample", values) for key, values in columns.items()}, attrs={"tests": json.dumps(rows)})


def grid(temperature: np.ndarray, frequency: np.ndarray, storage: np.ndarray, loss: np.ndarray) -> xr.Dataset:
    """Return readings of sweeps over temperature and frequency [Hz]."""
    index = pd.MultiIndex.from_arrays([temperature, frequency], names=["temperature", "frequency"])
    return pd.DataFrame({"storage": storage, "loss": loss}, index).to_xarray()


def shifts(curve: MasterCurve, published: np.ndarray, u_published: float) -> list[Value]:
    """Compare shift factors but that of the reference, from cold to warm."""
    found, u = curve.log10_aT.values, curve.u_log10_aT.values
    away = np.abs(curve.log10_aT["temperature"].values - curve.T_ref) > 1.0
    return [Value(*row) for row in zip(published[away], u_published + 0 * u[away], found[away], u[away], strict=True)]


@PublishedCase(
    "log a_T of polyisobutylene relaxing, −79.3 to −74.1 °C",
    "Catsiff & Tobolsky 1955",
    "45 readings, 5 isotherms",
    "the isotherms do not superpose, as labpipe says, but its u is too small",
)
def polyisobutylene() -> list[Value]:
    """Figure digitised and shifts typed by K. R. Lennon, github.com/krlennon/mastercurves, demos/catsiff_demo.py."""
    tests = step_tests("polyisobutylene.csv", "relaxation_modulus", 0.1, 3600.0)
    curve = quiet_curve(tests, -74.1, nu=0.5, mode="tension")
    return shifts(curve, np.array([11.51, 10.70, 9.70, 8.85, 7.93]) - 9.70, 2**0.5 * 0.01 * ROUNDED)


@PublishedCase(
    "log a_T of polystyrene creeping, 97 to 104.5 °C",
    "[Plazek 1965](https://doi.org/10.1021/j100894a039)",
    "53 readings, 5 isotherms",
)
def polystyrene() -> list[Value]:
    """Figure digitised and WLF law typed by K. R. Lennon, github.com/krlennon/mastercurves, demos/tts_demo.py."""
    curve = quiet_curve(step_tests("polystyrene.csv", "creep_compliance", 10.0, 1.0), 104.5, nu=0.5, mode="shear")
    law = -10.7 * (curve.log10_aT["temperature"].values - 100.0) / (curve.log10_aT["temperature"].values - 70.1)
    return shifts(curve, law - np.interp(104.5, curve.log10_aT["temperature"], law), 0.007)  # constants rounded to 0.1


@PublishedCase(
    "log a_T, b_T of polyisoprene, −45 to −10 °C",
    "[RepTate](https://github.com/jorge-ramirez-upm/RepTate)",
    "28 readings, 4 isotherms, 94.9 kg/mol",
    "by 0.02 decades; one law for all molar masses, stated without u",
)
def polyisoprene() -> list[Value]:
    """Files PI88K-09_FS of data/PI_LINEAR/osc; law of A. Likhtman in tools/CreateMaterialsDatabaseFile.py."""
    temperature, omega, storage, loss = np.loadtxt(FOLDER / "polyisoprene.csv", delimiter=",", unpack=True)
    curve = quiet_curve(grid(temperature, omega / (2.0 * np.pi), storage, loss), -10.0)
    # Chain ends lower the glass transition by K/M (Fox & Flory, 1950, doi:10.1063/1.1699711).
    T, chain_ends = curve.log10_aT["temperature"].values, 14.65 / 94.9
    law, weight = 691.6245 / (114.3 + chain_ends + T), (T + 273.15) / (1.0 + 10**-3.2147 * T)
    found = shifts(curve, law - law[T == -10.0], 0.01 * ROUNDED)
    vertical = zip(weight / weight[T == -10.0], curve.b_T.values, curve.u_b_T.values, strict=True)
    return found + [Value(b, 0.001 * ROUNDED, *measured) for b, *measured in vertical if b != 1.0]


def backsheet_table(name: str) -> np.ndarray:
    """Return the columns of a file of the backsheet."""
    form = {"delimiter": ",", "skiprows": 2, "unpack": True, "encoding": "utf-8-sig"}
    return np.loadtxt(SAMPLES / "dma" / name, **form)


def backsheet_sweeps() -> xr.Dataset:
    """Return the sweeps of the backsheet, by the mean temperature of each."""
    frequency, storage, loss, temperature, number = backsheet_table("backsheet_tension_21_temperatures.csv")
    mean = {k: temperature[number == k].mean() for k in np.unique(number)}
    return grid(np.array([mean[k] for k in number]), frequency.round(6), storage * 1e6, loss * 1e6)


@PublishedCase(
    "log a_T of a backsheet, −50 to −5 °C",
    "[pyvisco](https://doi.org/10.5281/zenodo.6384954)",
    "21 sweeps",
    "by 2 decades when warm; the sweeps do not superpose, as labpipe says, and E′ alone was shifted there",
    "dma/backsheet_published_shift_factors.csv",
    is_long=True,
)
def backsheet() -> list[Value]:
    """Both files are examples of the repository NREL/pyvisco, whose shifts are of the storage modulus alone."""
    T, log10_aT = backsheet_table("backsheet_published_shift_factors.csv")[:, ::-1]
    curve = quiet_curve(backsheet_sweeps(), -5.0)
    return shifts(curve, np.interp(curve.log10_aT["temperature"], T, log10_aT), 0.06 * ROUNDED)


@PublishedCase(
    "Plateau of a cylinder in rubber, N", "the thesis, 2.3.2", "R 2 mm, period 8 mm; 31.0 N at twice the depth"
)
def punch() -> list[Value]:
    """Forces and geometry as read in the text; "around 31 N" has a u of 0.3 N."""
    plateau = {}
    for depth in (1e-4, 2e-4, 3e-4):
        pressed = indent(Prony(7.6e6, [], [], nu=0.5), 2e-3, 8e-3, 6e-3, [0.0, 0.1], [0.0, depth], profile="cosine")
        plateau[depth] = float(pressed.force[-1])
    scale, share = 31.0 / plateau[2e-4], ROUNDED / 31.0
    read = ((1e-4, 12.2), (3e-4, 55.5))
    return [Value(N, 0.1 * ROUNDED, scale * plateau[d], share * scale * plateau[d]) for d, N in read]


@PublishedCase(
    "Stiffness in an oscillation, N/mm",
    "[Biomomentum](https://github.com/RenatoC322/Biomomentum-functions)",
    "its Mach-1 file, first block",
    "by 0.02 % and 0.02° of lag; the published fit states no window and no u",
    "mach1/dynamic_5_sinusoid_blocks.txt",
)
def mach1_oscillation() -> list[Value]:
    """Printed by examples/testing_notebook.ipynb, of the file among its examples: |K|, lag, amplitudes."""
    readings = instruments.read(SAMPLES / "mach1/dynamic_5_sinusoid_blocks.txt")
    block = readings.isel(sample=readings["block"].values == 0)
    window = active_window(block["time"], block["position_z"], 0.1)
    time, cycle = block["time"].values, 1.0 / window.frequency
    steady = block.isel(sample=(time > window.start + cycle) & (time < window.end - cycle))
    fit = common_fit(steady["time"], steady["position_z"], steady["force_z"], 0.1)
    K = fit.storage_stiffness / 1e3, fit.loss_stiffness / 1e3
    return [
        Value(911.837923, 1e-6, np.hypot(*K), fit.u_storage_stiffness / 1e3),
        Value(6.016547, 1e-6, np.degrees(fit.phase_lag), np.degrees(fit.u_phase_lag)),
        Value(43.029982, 1e-6, fit.force.amplitude, fit.force.u_amplitude),
        Value(0.04719, 1e-6, fit.position.amplitude * 1e3, fit.position.u_amplitude * 1e3),
    ]


@PublishedCase(
    "Displacement of a speckled specimen, px",
    "[muDIC](https://github.com/PolymerGuy/muDIC)",
    "photograph of a tension test, moved by known parts of a pixel",
    "speckles finer than a pixel: u is 20 % too small",
    "images/mudic/ut_151.tif",
    is_long=True,
)
def specimen_photograph() -> list[Value]:
    """A photograph among its examples; cut out moved by whole pixels, then averaged over 4 × 4 of them."""
    image = np.asarray(instruments.read(SAMPLES / "images/mudic/ut_151.tif", fps=1)[0], float)
    moves = np.array([(0, 0), (1, 2), (3, -1), (7, 5), (-10, 9)])
    rows, columns = (4 * ((size - 80) // 4) for size in image.shape)
    cut = [image[40 - y : 40 - y + rows, 40 - x : 40 - x + columns] for x, y in moves]
    frames = np.array([c.reshape(rows // 4, 4, columns // 4, 4).mean((1, 3)) for c in cut])
    x, y = np.meshgrid(np.arange(30, columns // 4 - 30, 16), np.arange(30, rows // 4 - 30, 16))
    found = track(frames, np.column_stack([x.ravel(), y.ravel()]).astype(float), subset=21)
    return [
        Value(moves[i, axis] / 4.0, 0.0, float(found[name][i, j]), float(found[f"u_{name}"][i, j]))
        for i in range(1, len(moves))
        for j in np.flatnonzero(found["valid"][i])
        for axis, name in enumerate(("dx", "dy"))
    ]


def impact(material: Prony, radius: float, mass: float, speed: float, glass: object = None) -> tuple[xr.Dataset, float]:
    """Return one impact without gravity, and the relative error of its restitution, from a coarser run."""
    g = 1e-3  # m/s², almost none, as in the theories
    fall = partial(drop, material, radius, mass, speed**2 / 2 / g, speed / g + 1, gravity=g, substrate=glass)
    fine, coarse = fall(rtol=1e-8), fall(rtol=1e-7)
    return fine, abs(float(coarse.restitution[0] - fine.restitution[0])) + 1e-8


@PublishedCase(
    "Peak force of colliding spheres, N",
    "[Chung & Ooi 2011](https://doi.org/10.1007/s10035-011-0277-0), tests 1, 2",
    "exact",
)
def benchmark_forces() -> list[Value]:
    """Forces as in paper_data of the benchmarks of Kratos, inputs as in Test1.py and Test2.py of Yade."""
    limestone, magnesium = (20e9, 0.25, 2500, 0.01, 10.0, 7108), (40e9, 0.35, 1800, 0.1, 0.2, 7233)
    found = []
    for E, nu, density, radius, speed, newton in (limestone, magnesium):
        seen, error = impact(Prony(E, [], [], nu=nu), radius, density * 4 / 3 * np.pi * radius**3, speed)
        found.append(Value(newton, ROUNDED, float(seen.peak_force[0]), error * newton))
    return found


@PublishedCase(
    "Coefficients of contact time, peak force",
    "[McLaskey & Glaser 2010](https://doi.org/10.1121/1.3466847)",
    "steel ball on glass, 1 m/s",
)
def steel_on_glass() -> list[Value]:
    """t = 4.53 (4πρδ/3)^(2/5) R v^(-1/5), F = 1.917 ρ^(3/5) δ^(-2/5) R² v^(6/5), of public stf_herzian_mclaskey2009."""
    E, nu, glass, density, radius, speed = 208e9, 0.3, (62e9, 0.24), 7850.0, 1.5e-3, 1.0
    seen, error = impact(Prony(E, [], [], nu=nu), radius, density * 4 / 3 * np.pi * radius**3, speed, glass)
    soft = ((1 - nu**2) / E + (1 - glass[1] ** 2) / glass[0]) / np.pi
    time = float(seen.contact_duration[0]) / ((4 * np.pi * density * soft / 3) ** 0.4 * radius * speed**-0.2)
    force = float(seen.peak_force[0]) / (density**0.6 * soft**-0.4 * radius**2 * speed**1.2)
    return [Value(4.53, 0.01 * ROUNDED, time, error * time), Value(1.917, 0.001 * ROUNDED, force, error * force)]


@PublishedCase(
    "(1 − e)/β of a viscoelastic sphere, β → 0", "[Müller & Pöschel 2011](https://arxiv.org/abs/1102.5247)", "exact"
)
def viscous_sphere() -> list[Value]:
    """C = 1.15345 of their approximant as coded publicly; β = (3/2)A (k/m)^(2/5) v^(1/5), memory a twentieth of A."""
    E, radius, mass, speed, beta = 1e9, 0.01, 0.01, 0.5, 0.003
    A = beta / 1.5 / ((4 / 3 * E * np.sqrt(radius) / mass) ** 0.4 * speed**0.2)
    body = Prony(E, [20.0 * E], [A / 20.0], nu=0.0)
    (slow, error), (fast, _) = (impact(body, radius, mass, v) for v in (speed, 32.0 * speed))
    lost = [(1.0 - float(seen.restitution[0])) / b for seen, b in ((slow, beta), (fast, 2.0 * beta))]
    return [Value(1.15345, 1e-5 * ROUNDED, 2.0 * lost[0] - lost[1], float(np.hypot(2.0 * error / beta, beta**1.5)))]


@PublishedCase(
    "Loss of a Maxwell sphere times relaxation time over duration", "Hunter 1960", "exact; limit of short impacts"
)
def maxwell_sphere() -> list[Value]:
    """The limit 4/9 as a survey of viscoelastic contact cites it; the paper itself was not read."""
    E, radius, mass, speed, ratio = 1e9, 0.01, 0.01, 1.0, 300.0
    duration = float(hertz.impact(speed, radius, mass, E).contact_duration)
    bodies = [Prony(1e-9 * E, [E], [n * ratio * duration], nu=0.0) for n in (1, 2)]
    (short, _), (long, error) = (impact(body, radius, mass, speed) for body in bodies)
    found = ratio * (4.0 * (1.0 - float(long.restitution[0])) - (1.0 - float(short.restitution[0])))
    return [Value(4 / 9, 0.0, found, float(np.hypot(4.0 * error * ratio, 1.0 / ratio**2)))]
