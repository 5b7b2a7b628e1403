"""The thesis's printed numbers compared with ours, with a verdict for each.

A row agrees when ours lies within the stated distance of the printed value: half of the last
printed digit, or the text's "about"; where ours was chosen so that it does, the row says
so. Otherwise it carries a reason: a misprint (an error of print, which the context corrects), a
statement that contradicts another one or the equations, a number that no linear viscoelastic solid
gives, or data that only the thesis's author has (the DMA spectra, the recordings).

The peak forces. At one speed v of the ramp the force at its end is, by superposition,
``F_peak / F_plateau - 1 = sum_j (E_j / E_relaxed) w(T / rho_j)`` with T the ramp's duration and ``w`` the
mean of ``exp(-(T - t) / rho)`` over the growth of the elastic force S during the ramp. S grows nearly as
one power of the depth, so that w depends on ``T / rho`` alone and falls with it: the excess of the
peak must fall from depth to depth for every spectrum without negative weights. Printed are 0.893,
0.442 and 0.452: it rises from 0.2 to 0.3 mm, and still does with every force off by half a digit
(0.446 and 0.450). :func:`best_excesses` fits any spectrum to them.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import pi, sqrt
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq, nnls

from calibration.camera import pixel_size
from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.contact import contact_stiffness
from labpipe.contact.line import westergaard
from labpipe.contact.sphere import hertz
from labpipe.units import Quantity
from pipelines.figures.chapter2 import least_force
from pipelines.rig.apparatus import PUNCH, SPHERE, VIEWS

Verdict = Literal[
    "agrees",
    "agrees, set to it",
    "misprint",
    "inconsistent",
    "inconsistent with linear viscoelasticity",
    "depends on unavailable data",
]

_CONTRADICTS: Verdict = "inconsistent"
_UNAVAILABLE: Verdict = "depends on unavailable data"
_NONLINEAR: Verdict = "inconsistent with linear viscoelasticity"

_INDENTATIONS, _PEAKS, _PLATEAUS = zip(*PUNCH.forces, strict=True)


@dataclass(frozen=True, slots=True)
class Row:
    """One printed number and ours.

    ``place`` is a section, figure, table or equation of the thesis, or "reference" for a number that follows from its
    inputs but is not printed; ``printed`` and ``ours`` are in ``unit``, and ``within`` is the distance that still
    counts as agreement. ``why`` says why ours differs, ``differs_by`` is the verdict then, and ``set_by`` says how ours
    was chosen to agree; empty where it follows from other numbers.
    """

    place: str
    quantity: str
    printed: float
    ours: float
    unit: str
    within: float
    why: str = ""
    differs_by: Verdict = "misprint"
    set_by: str = ""

    @property
    def difference(self) -> float:
        """Ours minus printed."""
        return self.ours - self.printed

    @property
    def verdict(self) -> Verdict:
        """The verdict on the difference; the last digits of a decimal number are not exact in binary."""
        if abs(self.difference) > self.within * (1 + 1e-9):
            return self.differs_by
        return "agrees, set to it" if self.set_by else "agrees"

    @property
    def reason(self) -> str:
        """Why it differs, or how it was made to agree; empty when it agrees by itself."""
        return {"agrees": "", "agrees, set to it": self.set_by}.get(self.verdict, self.why)

    def document(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self) | {"difference": self.difference, "verdict": self.verdict, "reason": self.reason}

    def line(self) -> str:
        """Return the row as one line of text."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        numbers = f"{self.printed:.4g} | {self.ours:.4g} | {self.difference:+.2g}{unit}"
        why = f" ({self.reason})" if self.reason else ""
        return f"{self.place:14} {self.quantity:48} {numbers:36} {self.verdict}{why}"


def rows() -> tuple[Row, ...]:
    """Return the whole check table."""
    parts = (_conventions, _indenter, _tapping, _impacts, _rig)
    return tuple(row for part in parts for row in part())


def _conventions() -> Iterator[Row]:
    """Signs and factors of equations, as numbers."""
    solid = materials.Prony(1.0, [3.0], [1.0], nu=0.5)
    lead = float(np.sign(np.angle(solid.complex_modulus(0.5))))
    why = "with a minus sign a cycle would give energy; (1.15) has plus"
    yield Row("1.1", "sign of delta in sigma_A sin(omega t - delta)", -1, lead, "1", 0, why, _CONTRADICTS)
    ratio = contact_stiffness(1.0, 1.0, 0.0) * 3
    why = "2 is for two equal spheres; a sphere on a rigid flat, which the text describes, has 4"
    yield Row("A.1", "factor of E sqrt(a)/(3(1-nu^2)) in chi", 2, ratio, "1", 1e-9, why, _CONTRADICTS)
    why = "the unit is m: it is the yield depth of 20 um, not a stress"
    yield Row("A.1 text", "is the 'yield stress of 2.0e-5 m' a stress? (1 yes)", 1, 0, "1", 0, why)
    why = "mm over s is mm/s, not um/s; the /1000 is right"
    yield Row("3.14 (eq.)", "velocity unit before /1000, in m/s", 1e-6, 1e-3, "m/s", 0, why)
    modulus, angle = complex(solid.complex_modulus(0.5)), 0.5 * np.linspace(0.0, 40.0 * pi, 4001)
    stress = materials.respond(solid, angle / 0.5, np.sin(angle))["stress"].values[-201:-1]  # the last whole cycle
    found = 2.0 * abs(np.mean(stress * np.exp(1j * angle[:200]))) / abs(modulus)
    printed = abs(np.exp(1j * angle[0] + np.angle(modulus)))
    why = "brackets are missing: exp(i (omega t + delta)); as printed the amplitude grows with the phase"
    yield Row("1.15", "amplitude of the stress over |G*| epsilon_0", float(printed), float(found), "1", 1e-3, why)
    # (1.17) with (1.22) for an ideal rubber, whose stored energy is -theta times its entropy
    time = np.linspace(0.0, 4.0, 4001)
    made = materials.respond(solid, time, np.minimum(time, 1.0))
    work = float(np.trapezoid(made["stress"], made["strain"]))
    stored, heat = float(made["stored_energy"][-1]), -float(made["stored_energy"][-1])  # theta s, at constant theta
    left, lost = work - stored - heat, float(made["dissipated_energy"][-1])  # of (1.16): all but the term of (1.17)
    why = "the dot belongs to the entropy, rho theta ds/dt: as printed (1.22) does not follow at constant temperature"
    name = "dissipation by (1.16), (1.17) over (1.22), rubber"
    yield Row("1.17", name, left / lost, (left + heat) / lost, "1", 1e-3, why)
    # log a_T of a warmer, softer solid as factor of time and of frequency
    warm, decades = solid.shifted(10.0 ** float(materials.wlf(15.0, 250.0, 20.0).log10_aT(30.0))), (-6.0, 6.0)
    of_time = brentq(lambda x: float(solid.relaxation(10.0**x) - warm.relaxation(1.0)), *decades)
    of_frequency = brentq(lambda x: (solid.complex_modulus(10.0**x) - warm.complex_modulus(1.0)).real, *decades)
    why = "(1.26) multiplies the time by a, (2.35) the frequency; of a material that softens one rises, one falls"
    name, signs = "sign of d log a_T / d T by both", np.sign([of_time, of_frequency])
    yield Row("1.26, 2.35", name, float(signs[0]), float(signs[1]), "1", 0, why, _CONTRADICTS)
    yield Row("1.40", "retardation over relaxation time, beta = 4", 4, float(solid.creep_terms()[1][0]), "1", 1e-12)


def _indenter(modulus: float = 10.14e6) -> Iterator[Row]:
    """Sizes and times of chapter 2, and its forces by the one relaxed contact modulus [Pa] that gives the plateaus."""
    for depth, printed in zip(_INDENTATIONS, (0.05, 0.10, 0.15), strict=True):
        found = depth / PUNCH.radius
        yield Row("2.4", f"Delta/R at {depth * 1e3:g} mm", printed, found, "1", 1e-9)
    for frequency, figure, printed in ((0.5, "2.5", 0.78e-10), (2.0, "2.7", 3.12e-10)):
        found = frequency * PUNCH.tau_0
        yield Row(figure, f"f tau_0 at {frequency:g} Hz", printed, found, "1", 5e-13)
    why = "the frequency f tau_0 is printed as an amplitude"
    yield Row("2.7 caption", "amplitude over R", 3.12e-10, 0.15, "1", 1e-3, why)
    yield Row(
        "2.1", "width that three tips of R = 2 mm span", 20.0, (2 * PUNCH.period + 2 * PUNCH.radius) * 1e3, "mm", 0.5
    )
    times = materials.load("nbr").creep_terms()[1]
    why, set_by = (
        "the DMA spectrum; ours is one term per decade",
        "the library's terms were laid over the printed range",
    )
    own = (PUNCH.tau_0, float(times[0]), "s", 5e-13, why, _UNAVAILABLE, set_by)
    yield Row("2.38", "shortest retardation time of nbr", *own)
    for word, printed, ours in (("shortest", -10.0, times.min()), ("longest", 2.0, times.max())):
        # "Approximately" a power of ten: half a decade either way.
        name, found = f"log10 of nbr's {word} time in s, 'about'", float(np.log10(ours))
        yield Row("2.3.1", name, printed, found, "1", 0.5, why, _UNAVAILABLE, set_by)
    set_by = "the one modulus 10.14 MPa was fitted to the three plateaus; what agrees is their ratios"
    for depth, printed in zip(_INDENTATIONS, _PLATEAUS, strict=True):
        state = westergaard.from_displacement(depth, PUNCH.radius, PUNCH.period, modulus, "cosine")
        name, found = f"plateau force at {depth * 1e3:g} mm", float(state.force) * PUNCH.length
        # One modulus for three plateaus; 3 % covers the tips' shape and the force's calibration.
        yield Row("2.3.2", name, printed, found, "N", 0.03 * printed, set_by=set_by)
    depth = _INDENTATIONS[0]
    time = depth / 1e-3 + np.array([-depth / 1e-3, 0.0, 200.0, 600.0])
    rubber, moved = materials.load("nbr"), np.array([0.0, depth, depth, depth])
    made = contact.indent(rubber, PUNCH.radius, PUNCH.period, PUNCH.length, time, moved, "circle", elements=512)
    kept = float(made["force"][2] / made["force"][3])
    yield Row("2.3.2", "force after 200 s over that after 600 s, 'stable'", 1.0, kept, "1", 0.03)
    excess = tuple(peak / plateau - 1.0 for peak, plateau in zip(_PEAKS, _PLATEAUS, strict=True))
    why = "of the three: at one speed the excess falls with depth for every spectrum; ours fits best"
    set_by = "ours is the best of all spectra for the three printed excesses"
    columns = (_INDENTATIONS, _PEAKS, _PLATEAUS, excess, best_excesses(excess))
    for depth, peak, plateau, printed, ours in zip(*columns, strict=True):
        within = (0.05 / peak + 0.05 / plateau) * peak / plateau  # half a digit of either force
        name = f"peak over plateau less 1 at {depth * 1e3:g} mm"
        yield Row("2.3.2", name, printed, ours, "1", within, why, _NONLINEAR, set_by)


def left_of_terms(rho: Floats) -> Floats:
    """Return how much of relaxing terms ``rho`` [s] is left (depth, term) at the end of each ramp of section 2.3.2.

    It is the mean of ``exp(-(T - t) / rho)`` over the growth of the elastic force, w in the module's notes.
    """
    left = []
    for depth in _INDENTATIONS:
        t = np.linspace(0.0, depth / 1e-3, 4001)
        force = np.asarray(westergaard.from_displacement(t * 1e-3, PUNCH.radius, PUNCH.period, 1.0, "cosine").force)
        remaining = np.exp(-(t[-1] - 0.5 * (t[1:] + t[:-1]))[:, None] / rho)
        left.append(np.diff(force) @ remaining / force[-1])
    return np.array(left)


def best_excesses(excess: tuple[float, ...]) -> tuple[float, ...]:
    """Return the peaks' excess by the best spectrum without negative weights, of any number of terms.

    Excess is F_peak / F_plateau - 1 at the three depths of section 2.3.2, reached at 1 mm/s.
    """
    rho = np.geomspace(1e-4, 1e3, 141)  # s; faster ones only scale, slower ones have not relaxed
    weights = left_of_terms(rho)
    found, _ = nnls(weights, np.array(excess))
    return tuple(float(value) for value in weights @ found)


def _tapping() -> Iterator[Row]:
    rubber = materials.load("nbr")
    mean = 0.05 * PUNCH.radius
    slow, fast = contact.tapping_amplitude(rubber, [0.0, 1e15], mean, PUNCH.radius, PUNCH.period)
    sign, why = float(np.sign(fast - slow)), "|E| in (2.34) rises with frequency, so the critical amplitude falls"
    yield Row("2.34 text", "sign of d alpha / d frequency", 1, sign, "1", 0, why, _CONTRADICTS)
    why = "white is above the front, and the caption calls white the detachment region; simulated, the force ends there"
    frequency = 1e2  # Hz, above the front
    beyond = 2.0 * float(contact.tapping_amplitude(rubber, frequency, mean, PUNCH.radius, PUNCH.period))
    least = least_force(rubber, beyond, frequency)
    name = "is contact continuous above the front? (1 yes)"
    yield Row("2.3.3", name, 1, float(least > 0.0), "1", 0, why, _CONTRADICTS)
    yield Row("2.34 text", "alpha(0)/Delta_0, 'about'", 1.0, float(slow) / mean, "1", 0.25)
    ratio = float(fast) / mean * rubber.E_unrelaxed / rubber.E_relaxed
    yield Row("2.34 text", "alpha(inf) beta/Delta_0, 'about'", 1.0, ratio, "1", 0.25)


def _impacts() -> Iterator[Row]:
    for height, printed in zip(SPHERE.heights, (0.1715, 0.3132, 0.3706, 0.4429), strict=True):
        speed = float(hertz.drop_speed(height, SPHERE.gravity))
        yield Row("reference", f"impact speed from {height * 1e3:g} mm", printed, speed, "m/s", 1e-4)
    ptfe = contact.drop(materials.load("ptfe"), SPHERE.radius, SPHERE.mass, 7e-3, 0.3)
    yield Row("3.3.2", "first contact of PTFE from 7 mm", 0.04, float(ptfe["impact_time"][0]), "s", 5e-3)
    over, why = float(ptfe["final_contact_time"]), "the library's ptfe was given the loss for it"
    yield Row("3.3.2", "last lift-off is over, PTFE from 7 mm", 0.15, over, "s", 0.01, set_by=why)
    rest, why = -7.0 + float(ptfe["displacement"][-1]) * 1e3, "the recording: zero of the laser, permanent set of PTFE"
    yield Row("3.3.2", "position at rest, PTFE from 7 mm", -7.1, rest, "mm", 0.05, why, _UNAVAILABLE)
    acrylic = contact.drop(materials.load("acrylic"), SPHERE.radius, SPHERE.mass, SPHERE.heights[0], 0.03)
    yield Row("3.3.3", "duration of an impact, 'about 10^-3 s'", 1e-3, float(acrylic["contact_duration"][0]), "s", 5e-4)
    modulus = 3.2e9 / (1 - 0.35**2)
    load = hertz.static_load(SPHERE.mass * SPHERE.gravity, SPHERE.radius, modulus)
    yield Row("reference", "Hertz radius at rest, E = 3.2 GPa", 0.213, float(load.contact_radius) * 1e3, "mm", 5e-4)
    fall = (materials.load("acrylic"), SPHERE.radius, SPHERE.mass, SPHERE.heights[0], 0.5)
    coarse = contact.drop(*fall, solver="thesis", ring_width=4e-5, time_step=2e-4)
    bounces = coarse.sizes["impact"] / contact.drop(*fall).sizes["impact"]
    why = "a contact of 1 ms has five such steps; the thesis's scheme agrees with the solution at steps of some us"
    yield Row("3.3.3", "bounces by steps of 0.2 ms over the true number", 1.0, bounces, "1", 0.05, why, _CONTRADICTS)
    for step, name in ((2e-4, "0.2 ms"), (4e-6, "4 us, not printed")):
        first = contact.drop(*fall[:-1], 0.02, solver="thesis", ring_width=4e-5, time_step=step)
        ratio = float(first["peak_force"][0] / acrylic["peak_force"][0])
        text = f"peak force by lambda = 40 um, dt = {name}"
        yield Row("3.3.3", text, 1.0, ratio, "1", 0.01, why, _CONTRADICTS)
    elastic = hertz.impact(sqrt(2 * SPHERE.gravity * SPHERE.heights[0]), SPHERE.radius, SPHERE.mass, modulus)
    # Hertz's peak pressure at the yield depth of 20 um is 1.6 times the yield stress
    stress = float(hertz.static_approach(20e-6, SPHERE.radius, modulus).peak_pressure) / 1.6
    why = "no unit is printed; by Hertz the yield depth of 20 um belongs to this stress: the range is a yield strain"
    yield Row("A.1 text", "'yield stress range of 0.02-0.04', as a stress", 0.03, stress, "Pa", 0.01, why)
    yield Row("A.1 text", "the same range as a strain, yield stress over E", 0.03, stress / 3.2e9, "1", 0.01)
    yield Row("reference", "Hertz approach, acrylic from 1.5 mm", 69.0, float(elastic.peak_approach) * 1e6, "um", 0.5)
    yield Row("3.1", "radius of a 3/4 inch sphere", 9.525, 0.75 * 25.4 / 2, "mm", 1e-9)
    sphere = 1180 * 4 / 3 * pi * SPHERE.radius**3
    why = "weighing; one value for four spheres, 0.15 % of all"
    yield Row("3.9 text", "mass of the sphere, acrylic 1180 kg/m3", 5.0, sphere * 1e3, "g", 0.5, why, _UNAVAILABLE)


def _size(length: float, pixels: float, u_pixels: float) -> Quantity:
    return pixel_size(Quantity(length, 0.0, "m"), Quantity(pixels, u_pixels, "px"))


def _rig() -> Iterator[Row]:
    """Return the loads, cameras and clocks of chapter 3."""
    load = SPHERE.mass
    yield Row("3.3.4", "load 1, holder and sphere", 0.5, load, "kg", 0.05)
    for number, (added, printed) in enumerate(zip((2.0, 1.0, 1.0, 1.0), (2.5, 3.5, 4.5, 5.5), strict=True), start=2):
        load += added
        yield Row("3.3.4", f"load {number} from the masses of 3.1", printed, load, "kg", 0.05)
    times = (2.55, 18.20, 33.10, 47.55)
    why = "3 min in 3.1, 2.55 min in 3.3.4 (2 min 55 s would be near)"
    yield Row("3.1, 3.3.4", "first hold", 3.0, times[0], "min", 0.2, why, _CONTRADICTS)
    for number, (before, after) in enumerate(pairwise(times), start=2):
        yield Row("3.1, 3.3.4", f"hold {number}, 'about every 15 min'", 15.0, after - before, "min", 1.0)
    front, disc = _size(30e-3, VIEWS.holder, 1), _size(1e-3, VIEWS.under, 1)
    yield Row("D.2", "front camera, in mm", 0.07772, front.value * 1e3, "mm/px", 5e-6)
    yield Row("D.2", "front camera, in um", 77.7, front.value * 1e6, "um/px", 0.05)
    yield Row("3.8 caption", "front camera", 77.7, front.value * 1e6, "um/px", 0.05)
    yield Row("D.3", "camera under the disc", 0.00217, disc.value * 1e3, "mm/px", 5e-6)
    yield Row("3.1", "camera under the disc", 2.17, disc.value * 1e6, "um/px", 5e-3)
    why = "printed in mm; 1 mm = 461 px gives 2.17 um"
    yield Row("3.14 caption", "camera under the disc", 2.17, disc.value * 1e3, "mm/px", 5e-3, why)
    for u_pixels, printed in ((1, 0.3), (2, 0.5)):
        size = _size(30e-3, VIEWS.holder, u_pixels)
        name, share = f"uncertainty of the front camera, {u_pixels} px", 100 * size.u / size.value
        yield Row("table D.1", name, printed, share, "%", 0.05)
    yield Row("table D.1", "uncertainty of the disc camera, 1 px", 0.2, 100 * disc.u / disc.value, "%", 0.05)
    ratio, why = front.value / disc.value, "the scales printed beside it differ by a factor 36, one and a half orders"
    yield Row("D.2 text", "front over disc, 'two orders of magnitude'", 100.0, ratio, "1", 50.0, why, _CONTRADICTS)
    name, why = "PEEK's T_0 against the hottest sweep", "T_0 lies outside the stated sweeps"
    yield Row("3.3.1", name, 129.93, 120.0, "degC", 1.0, why, _CONTRADICTS)
    yield Row("D.1 text", "time between frames at 10,000 per second", 0.1, 1e3 / 10_000, "ms", 1e-9)
    yield Row("3.1", "time step of the laser at 20 kHz", 50.0, 1e6 / 20_000, "us", 1e-9)
