"""Figures of chapter 2 that are computed: the dissipation map and the tapping indenter.

Geometry and protocol are the thesis's: three tips of 2 mm radius, 8 mm apart, 6 mm deep; ramp at
1 mm/s, 600 s of rest, then the oscillation.
"""

from typing import Any

import numpy as np

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import dissipation
from labpipe.materials import Prony
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, decades, label_outside, legend_above, letter, panels, right_axis
from pipelines.figures.inputs import Inputs, solid_or_library
from pipelines.rig.apparatus import PUNCH

_PUNCH = PUNCH.radius, PUNCH.period, PUNCH.length
_MEAN = 0.05 * PUNCH.radius
_AMPLITUDE = 0.005 * PUNCH.radius


def oscillation(mean: float, amplitude: float, frequency: float, cycles: int, per_cycle: int) -> tuple[Floats, Floats]:
    """Return times [s] and displacements [m] of ramp, rest and oscillation, the thesis's protocol."""
    # A ramp and a rest are straight lines; the simulator chooses its own steps on them.
    begin = np.array([0.0, mean / PUNCH.speed, mean / PUNCH.speed + PUNCH.hold])
    phase = np.linspace(0.0, cycles, per_cycle * cycles + 1)[1:]
    swing = mean + amplitude * np.sin(2 * np.pi * phase)
    time = np.concatenate([begin, begin[-1] + phase / frequency])
    return time, np.concatenate([[0.0, mean, mean], swing])


def _cycle(rubber: Prony, amplitude: float, frequency: float, samples: int = 80) -> tuple[float, float]:
    """Simulate two cycles: least force over mean force, and work dissipated in the second."""
    time, moved = oscillation(_MEAN, amplitude, frequency, 2, samples)
    made = contact.indent(
        rubber, *_PUNCH, time, moved, profile="cosine", elements=256, rtol=1e-3, outputs=("energy",)
    )  # the tolerance 1e-4 moves no dot of figure 2.6 by more than 0.1 %
    force, lost = made["force"].values, made["dissipated_energy"].values
    rest = force[-2 * samples - 1]
    return float(force[-samples:].min() / rest), float(lost[-1] - lost[-samples - 1])


def least_force(rubber: Prony, amplitude: float, frequency: float) -> float:
    """Return the least force of a simulated cycle over the force at rest."""
    return _cycle(rubber, amplitude, frequency)[0]


def simulated_front(rubber: Prony, frequency: float) -> float:
    """Return the amplitude [m] at which the simulated least force of a cycle falls to zero.

    The secant rule on the least force, from below: beyond the front it is zero and says nothing.
    """
    scale = float(contact.tapping_amplitude(rubber, frequency, _MEAN, *_PUNCH[:2]))
    older, old = 1.0, 1.1
    before, now = (_cycle(rubber, k * scale, frequency)[0] for k in (older, old))
    for _ in range(2):
        # Stay a hundredth short of the estimated zero, so that the next force is not zero.
        new = old + 0.99 * now * (old - older) / (before - now)
        older, old, before, now = old, new, now, _cycle(rubber, new * scale, frequency)[0]
    return (old + now * (old - older) / (before - now)) * scale


def dissipation_map(inputs: Inputs | None, frequencies: tuple[float, ...] = (1e-1, 1e2, 1e4, 1e6, 1e8, 1e9)) -> Drawing:
    """Figure 2.6: dissipated work over frequency and amplitude, with the detachment front, simulated at some [Hz]."""
    rubber, origin, sweeps = solid_or_library(inputs, "nbr")
    frequency, amplitude = decades(-2, 10, 20), PUNCH.radius * decades(-4, -1, 60)
    geometry = (_MEAN, *_PUNCH[:2])
    spots = np.array(frequencies)
    found = np.array([simulated_front(rubber, f) for f in spots])
    analytic = contact.tapping_amplitude(rubber, spots, *geometry)
    simulated = [_cycle(rubber, _AMPLITUDE, f)[1] for f in spots]
    x = frequency * PUNCH.tau_0
    x_spots = spots * PUNCH.tau_0

    def scaled(joules: Any) -> Floats:
        return dissipation.dimensionless_work(joules, rubber, *_PUNCH)

    plane = (rubber, frequency, amplitude[:, None], *geometry, PUNCH.length)
    decade = np.log10(scaled(contact.dissipated_work(*plane, beyond="nan")))
    section = scaled(contact.dissipated_work(rubber, frequency, _AMPLITUDE, *geometry, PUNCH.length))
    front = contact.tapping_amplitude(rubber, frequency, *geometry)
    touching, points = front >= _AMPLITUDE, line_arguments("measured", style="points")
    look = line_arguments("reference") | {"color": "black"}
    with panels(1, 2, width=2, aspect=0.42) as (figure, axes):
        first, second = axes[0]
        levels = np.arange(np.floor(np.nanmin(decade)), np.ceil(np.nanmax(decade)) + 0.5, 0.5)
        shown = first.contourf(x, amplitude / PUNCH.radius, decade, levels=levels, cmap="cividis")
        figure.colorbar(shown, ax=first, label="work $\\log_{10}\\tilde W$ (1)").outline.set_linewidth(0.6)
        first.loglog(x, front / PUNCH.radius, label="front, eq. (2.34)", **line_arguments("model"))
        first.loglog(x_spots, found / PUNCH.radius, label="front, simulated", **points)
        limits = (amplitude[0] / PUNCH.radius, amplitude[-1] / PUNCH.radius)
        first.set(ylabel="amplitude $\\tilde\\alpha = \\alpha/R$ (1)", ylim=limits)
        first.grid(visible=False)
        second.loglog(x[touching], section[touching], label="eq. (2.31), contact", **(look | {"linestyle": "-"}))
        second.loglog(x[~touching], section[~touching], label="eq. (2.31), tapping", **look)
        second.loglog(x_spots, scaled(simulated), label="simulated", **points)
        second.set(ylabel="work $\\tilde W$ (1)", ylim=(section.min() / 30, section.max() * 2))
        for name, place in zip("ab", axes[0], strict=True):
            letter(place, name)
            place.legend(loc="upper right" if name == "a" else "lower left")
            place.set_xlabel("frequency $\\tilde f = f\\tau_0$ (1)")
    ratio = found / analytic
    ripple = ", tuned on the thesis's plateaus alone; its one term per decade shows as a ripple"
    return Drawing(
        "(a) Dimensionless work dissipated per cycle, eq. (2.31), over frequency and amplitude at mean indentation "
        "0.05 R; white: the indenter leaves the surface. (b) The same at amplitude 0.005 R; dashed: beyond the front, "
        f"where (2.31) extrapolates. R = 2 mm, period 8 mm, depth 18 mm, tau_0 = {PUNCH.tau_0:.3g} s; work "
        "over E_relaxed times period times R times depth.",
        figure,
        computed=(
            "map and line from eqs. (2.31) and (2.34); dots from the boundary-element simulator (600 s of rest, then "
            "two cycles), in (a) the amplitude at which its least force falls to zero, in (b) the work of the second "
            f"cycle. The material is {origin}{ripple if inputs is None else ''}."
        ),
        difference=(
            f"the simulated front lies at {ratio.min():.2f} to {ratio.max():.2f} times (2.34), which keeps the contact "
            "width while the real one shrinks. The text after (2.34) has the trend reversed: the critical amplitude "
            "falls as the frequency rises (from near Delta_0 to Delta_0/beta, as the text itself says further on). "
            "Levels differ from the printed map as far as the thesis's DMA spectrum differs from this one."
        ),
        **sweeps,
    )


def tapping_cycle(inputs: Inputs | None, amplitudes: tuple[float, ...] = (0.15, 0.175, 0.2)) -> Drawing:
    """Figure 2.7: pressure and surface over one cycle of a large oscillation, and the lag of force and displacement.

    Of the amplitudes (in radii), the printed one and larger ones, the first counts with which contact is lost.
    """
    rubber, origin, sweeps = solid_or_library(inputs, "nbr")
    samples, frequency, kept = 80, 2.0, ""
    for amplitude in amplitudes:
        time, moved = oscillation(0.25 * PUNCH.radius, amplitude * PUNCH.radius, frequency, 3, samples)
        made = contact.indent(rubber, *_PUNCH, time, moved, "circle", elements=512, outputs=("pressure", "surface"))
        last = made.isel(time=slice(-samples - 1, None))
        force, depth = last["force"].values, last["displacement"].values
        if force.min() == 0.0:
            break
        kept += f"At amplitude {amplitude:g} R this material keeps contact, with {force.min():.2f} N at least. "
    x = made["x"].values
    near = np.abs(x) < 0.95 * PUNCH.radius
    tip = PUNCH.radius - np.sqrt(PUNCH.radius**2 - x[near] ** 2)
    with panels(3, 4, width=2, aspect=0.72, height_ratios=(1.0, 1.0, 0.8)) as (figure, axes):
        over_time = figure.add_subplot(axes[2, 0].get_gridspec()[2, :])
        for unused in axes[2]:
            unused.remove()
        top = 1.15e-6 * float(last["pressure"].max())
        for number, place in enumerate(axes[:2].flat):
            state = last.isel(time=number * samples // 8)
            place.plot(x * 1e3, state["pressure"].values / 1e6, label="pressure", **line_arguments("measured"))
            other = right_axis(place, "height (mm)", is_named=number % 4 == 3)
            other.plot(x * 1e3, -state["surface"].values * 1e3, label="surface (right)", **line_arguments("model"))
            height = (tip - float(state["displacement"])) * 1e3
            other.plot(x[near] * 1e3, height, label="indenter (right)", **line_arguments("reference"))
            other.set(xlim=(-2.0, 2.0), ylim=(-0.95, 0.95))
            place.set(ylim=(-top, top), yticks=np.arange(0.0, top, 2.0))  # the mean surface is where the pressure is 0
            place.tick_params(labelleft=number % 4 == 0, labelbottom=number > 3)
            is_lost = "no contact" if float(state["force"]) == 0.0 else f"{float(state['force']):.1f} N"
            letter(place, "abcdefgh"[number], f"$t/T$ = {number}/8, {is_lost}")
        label_outside(axes[:2], "position $x$ (mm)", "pressure (MPa)")
        legend_above(figure, [place, other])
        lead = _lag_panel(over_time, force, depth / PUNCH.radius)
    return Drawing(
        "(a) to (h) Contact pressure and height of surface and indenter, upwards positive and from the mean surface, "
        f"at eight moments of the third cycle; mean indentation 0.25 R, amplitude {amplitude:g} R, 2 Hz. (i) Force and "
        "indentation over the cycle; dotted: their largest values, shaded: no contact.",
        figure,
        computed=(
            f"boundary-element simulation of a periodic row of circular tips on {origin}, 512 strips per period, after "
            f"a ramp of 1 mm/s and 600 s of rest. {kept}By their first harmonics the force leads the indentation by "
            f"{lead:.0f} degrees ({lead / 360.0:.3f} T), as (a) and (e) show at equal depth. It reaches "
            f"{force.max():.0f} N, and {100 * np.mean(force[1:] == 0.0):.0f} % of the cycle is without contact. The "
            "kinks of (b) to (d) sit at the edge of the contact that has relaxed."
        ),
        difference=(
            "the printed caption gives the frequency as 'alpha = 3.12e-10'; that is f tau_0, 2 Hz, and the amplitude "
            "is 0.15 R. The amplitude of first loss follows from the DMA spectrum and lies close to the printed one."
        ),
        **sweeps,
    )


def _lag_panel(axes: Any, force: Floats, depth: Floats) -> float:
    """Draw force [N] and indentation [R] over a cycle with the time between their peaks; return the lead in degrees."""
    phase = np.linspace(0.0, 1.0, force.size)
    other = right_axis(axes, "indentation $\\Delta/R$ (1)")
    axes.plot(phase, force, label="force", **line_arguments("measured"))
    other.plot(phase, depth, label="indentation (right)", **line_arguments("model"))
    peaks = phase[np.argmax(force)], phase[np.argmax(depth)]
    for peak in peaks:
        axes.axvline(peak, **line_arguments("reference"))
    axes.annotate(f" {peaks[1] - peaks[0]:.2f} T", (peaks[1], 0.25 * force.max()), va="center", fontsize=7)
    between = {"arrowstyle": "<->", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (peaks[0], 0.25 * force.max()), (peaks[1], 0.25 * force.max()), arrowprops=between)
    axes.fill_between(
        phase, 0.0, 1.2 * force.max(), where=force == 0.0, color="#dddddd", linewidth=0, label="no contact"
    )
    axes.set(xlabel="time $t/T$ (1)", ylabel="force (N)", xlim=(0.0, 1.0), ylim=(0.0, 1.5 * force.max()))
    other.set_ylim(0.0, 1.5 * depth.max())
    handles, words = (
        first + second for first, second in zip(*(a.get_legend_handles_labels() for a in (axes, other)), strict=True)
    )
    axes.legend(handles, words, loc="upper right", ncols=3)
    letter(axes, "i")
    first = [series[1:] @ np.exp(-2j * np.pi * phase[1:]) for series in (force, depth)]
    return float(np.degrees(np.angle(first[0] / first[1])))
