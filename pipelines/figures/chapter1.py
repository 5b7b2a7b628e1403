"""Figures of chapter 1: linear viscoelasticity, in the material functions of labpipe.materials.

All moduli are in units of a reference modulus and all times in units of a relaxation time; the
figures hold for any values of both.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from labpipe.materials import Prony
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, decades, label_outside, legend_above, letter, panels, right_axis

_ZENER = Prony(1.0, [9.0], [1.0], nu=0.5)
"""Standard linear solid, E_unrelaxed/E_relaxed = 10: the contrast of figures 1.2 and 1.9."""

_DAMPER = Prony(1.0, [3.0], [1.0], nu=0.5)
"""Its loss factor peaks at 3/4 (37 degrees): a lag that can be seen, figure 1.1 (b)."""

_STORAGE = line_arguments("measured")
_LOSS = line_arguments("model")
_GUIDE: dict[str, Any] = line_arguments("reference")
_OVER = _GUIDE | {"color": "black"}  # where it lies on another curve


def harmonic_loading() -> Drawing:
    """Figure 1.1: elastic, viscoelastic and viscous stress under a sinusoidal strain."""
    omega = np.sqrt(_DAMPER.E_relaxed / _DAMPER.E_unrelaxed)  # where the loss factor peaks
    lag = float(np.angle(_DAMPER.complex_modulus(omega)))
    cases = (("a", "elastic", 0.0), ("b", "viscoelastic", lag), ("c", "viscous", np.pi / 2))
    phase = np.linspace(0.0, 4.0 * np.pi, 721)
    with panels(2, 3, width=2, aspect=0.56, sharey="all") as (figure, axes):
        for column, (name, word, delta) in enumerate(cases):
            strain, stress = np.sin(phase), np.sin(phase + delta)
            top, bottom = axes[0, column], axes[1, column]
            top.plot(phase / np.pi, stress, label="stress $\\sigma/\\sigma_A$", **_STORAGE)
            top.plot(phase / np.pi, strain, label="strain $\\varepsilon/\\varepsilon_A$", **_OVER)
            letter(top, name, f"{word}, $\\delta$ = {np.degrees(delta):.0f}°")
            top.set(xlabel="phase $\\omega t/\\pi$ (1)", xticks=range(5))
            bottom.plot(strain, stress, **_STORAGE)
            bottom.set(xlabel="strain $\\varepsilon/\\varepsilon_A$ (1)")
            bottom.set_box_aspect(0.8)
        for row, label in enumerate(("strain, stress (1)", "stress $\\sigma/\\sigma_A$ (1)")):
            axes[row, 0].set_ylabel(label)
        legend_above(figure, axes[0, 0])
    return Drawing(
        "Strain and stress over two cycles (top) and stress over strain (bottom), each over its amplitude: (a) "
        "elastic, (b) viscoelastic, (c) viscous. The loop's area is the work dissipated in a cycle, pi sin(delta) in "
        f"these units: 0, {np.pi * np.sin(lag):.3f} and {np.pi:.3f}.",
        figure,
        computed=(
            f"(b) is a standard linear solid, E_unrelaxed/E_relaxed = 4, at the frequency of "
            f"its largest loss factor 3/4, so delta = {np.degrees(lag):.2f} degrees."
        ),
        difference=(
            "the text writes sigma = sigma_A sin(omega t - delta); with the strain "
            "eps_A sin(omega t) that would give energy. Stress leads: + delta, as in (1.15)."
        ),
    )


def _modulus_panel(axes: Axes, solid: Prony, infinite: str) -> float:
    """Draw the complex modulus over its unrelaxed value, which has a symbol; return the peak of the loss."""
    x = decades(-3, 3)
    modulus = solid.complex_modulus(x) / solid.E_unrelaxed
    axes.semilogx(x, modulus.real, label="storage $G'$", **_STORAGE)
    axes.semilogx(x, modulus.imag, label="loss $G''$", **_LOSS)
    axes.axvline(1.0, label="$\\omega\\tau = 1$", **_GUIDE)
    axes.set(xlabel="frequency $\\omega\\tau$ (1)", ylabel=f"modulus over ${infinite}$ (1)", ylim=(0.0, 1.05))
    return float(modulus.imag.max())


def one_relaxation_time() -> Drawing:
    """Figure 1.2: storage and loss modulus of a standard linear solid."""
    with panels(aspect=0.72) as (figure, grid):
        axes = grid[0, 0]
        peak = _modulus_panel(axes, _ZENER, "G_\\infty")
        axes.annotate("$G_0$", (1e-3, _ZENER.E_relaxed / _ZENER.E_unrelaxed), (0, 4), textcoords="offset points")
        legend_above(figure, axes)
    return Drawing(
        "Complex modulus of a solid with one relaxation time tau, over its instantaneous "
        "modulus; E_unrelaxed/E_relaxed = 10.",
        figure,
        computed=(
            f"eq. (1.42) with one term. The loss modulus peaks at omega tau = 1, at {peak:.4f} (closed form 0.45)."
        ),
    )


def _polymer(E_relaxed: float, *processes: tuple[float, float, float]) -> Prony:
    """Sum processes that are normal in log10 of time: centre (decades), strength [Pa], width (decades)."""
    moduli, times = [], []
    for centre, strength, width in processes:
        exponents = np.arange(centre - 4 * width, centre + 4 * width + 1e-9, 0.25)
        weight = np.exp(-0.5 * ((exponents - centre) / width) ** 2)
        moduli.append(strength * weight / weight.sum())
        times.append(10.0**exponents)
    # Neighbouring processes overlap; equal times are merged by rounding to a quarter decade.
    unique, where = np.unique(np.round(np.log10(np.concatenate(times)), 6), return_inverse=True)
    summed = np.bincount(where, weights=np.concatenate(moduli))
    return Prony(E_relaxed, summed, 10.0**unique, nu=0.5)


def relaxation_processes() -> Drawing:
    """Figure 1.3: glass, transition, rubber, flow, and the alpha, beta and gamma processes."""
    # moduli in Pa: glass 3 GPa, rubber 1 MPa, as amorphous polymers have
    solid = _polymer(0.0, (0.0, 2.2e9, 0.7), (-5.0, 5e8, 0.6), (-8.5, 3e8, 0.6), (6.0, 1e6, 0.35))
    x = decades(-8, 11)
    modulus, factor = solid.complex_modulus(x), solid.loss_factor(x)
    peaks = x[1:-1][(factor[1:-1] > factor[:-2]) & (factor[1:-1] > factor[2:])]
    with panels(aspect=0.78) as (figure, grid):
        axes = grid[0, 0]
        other = right_axis(axes, "loss factor $\\tan\\delta$ (1)")
        axes.loglog(x, modulus.real, label="storage $G'$", **_STORAGE)
        other.loglog(x, factor, label="loss factor $\\tan\\delta$", **_LOSS)
        axes.set(
            xlabel="frequency $\\omega\\tau_\\alpha$ (1)  (falling temperature $\\rightarrow$)",
            ylabel="storage modulus $G'$ (Pa)",
            ylim=(1e1, 1e11),
        )
        other.set_ylim(1e-4, 1e3)
        for name, peak in zip(("\\alpha", "\\beta", "\\gamma"), peaks, strict=True):
            axes.axvline(peak, **_GUIDE)
            axes.text(peak, 4e10, f"$\\theta_{name}$", ha="center", va="bottom", backgroundcolor="white", fontsize=7)
        for place, word in ((5e-8, "flow"), (3e-5, "rubber"), (1.0, "transition"), (5e6, "glass")):
            axes.text(place, 2.2e1, word, ha="center", fontsize=7)
        legend_above(figure, [axes, other])
    return Drawing(
        "Storage modulus and loss factor of an uncrosslinked amorphous polymer over frequency; the alpha process is "
        "the glass transition, beta and gamma are local. The dotted lines mark the three peaks of the loss factor.",
        figure,
        computed=(
            "generalised Maxwell model (1.42) without equilibrium modulus: processes that are normal in log10 of time, "
            "centred at 1, 1e-5 and 10^-8.5 times the alpha time with 2.2, 0.5 and 0.3 GPa, and a flow process of 1 "
            "MPa at 1e6. The values are illustrative; they are no material of the thesis."
        ),
    )


def polymer_classes() -> Drawing:
    """Figure 1.4: amorphous and semi-crystalline thermoplastics, elastomers, thermosets."""
    classes = (
        ("a", "amorphous thermoplastic", _polymer(0.0, (0.0, 2.5e9, 0.7), (4.5, 1e6, 0.4))),
        ("b", "semi-crystalline thermoplastic", _polymer(0.0, (1.0, 1.8e9, 1.1), (6.0, 4e8, 0.4))),
        ("c", "elastomer", _polymer(2e6, (-3.0, 1.5e9, 0.9))),
        ("d", "thermoset", _polymer(1.2e9, (2.0, 1.3e9, 1.2))),
    )
    x = decades(-7, 5)
    with panels(2, 2, width=2, aspect=0.56, sharex="all", sharey="all") as (figure, axes):
        others = []
        for place, (name, word, solid) in zip(axes.flat, classes, strict=True):
            other = right_axis(place, "loss factor $\\tan\\delta$ (1)", is_named=name in "bd")
            place.loglog(x, solid.complex_modulus(x).real, label="storage $G'$", **_STORAGE)
            other.loglog(x, solid.loss_factor(x), label="loss factor $\\tan\\delta$", **_LOSS)
            letter(place, name, word)
            place.set_ylim(1e4, 1e11)
            other.set_ylim(1e-6, 1e3)
            others.append(other)
        label_outside(axes, "frequency $\\omega\\tau$ (1)", "storage modulus $G'$ (Pa)")
        legend_above(figure, [axes[0, 0], others[0]])
    return Drawing(
        "Storage modulus and loss factor of four classes of polymers over frequency: (a) "
        "amorphous and (b) semi-crystalline thermoplastics flow in the end, (c) elastomers "
        "and (d) thermosets keep an equilibrium modulus; the thermoset's transition is weak.",
        figure,
        computed=(
            "generalised Maxwell models (1.42) with one or two processes that are normal in "
            "log10 of time; the values are illustrative and no material of the thesis."
        ),
    )


def three_panels(element: str) -> Drawing:
    """Figures 1.7 and 1.9: relaxation, creep and complex modulus of a Maxwell element, or of the standard solid."""
    is_maxwell = element == "Maxwell"
    solid, creep_end = (Prony(0.0, [1.0], [1.0], nu=0.5), 5.0) if is_maxwell else (_ZENER, 25.0)
    t, unit = np.linspace(0.0, creep_end, 401), solid.E_unrelaxed
    with panels(1, 3, width=2, aspect=0.34) as (figure, axes):
        first, second, third = axes[0]
        first.plot(t, solid.relaxation(t) / unit, **_STORAGE)
        first.set(ylabel="relaxation modulus $G/E_\\infty$ (1)")
        second.plot(t, solid.creep(t) * unit, **_STORAGE)
        second.set(ylabel="creep compliance $J E_\\infty$ (1)")
        for place in (first, second):
            place.set(xlabel="time $t/\\tau$ (1)", ylim=(0.0, None))
        peak = _modulus_panel(third, solid, "E_\\infty")
        for name, place in zip("abc", axes[0], strict=True):
            letter(place, name)
        legend_above(figure, third)
    if is_maxwell:
        shows = "Maxwell element with stiffness E and relaxation time tau = mu/E: {}; E_inf = E."
        computed = (
            "eqs. (1.33), (1.34), (1.36) as the special case of one term without equilibrium "
            f"modulus; the loss modulus peaks at {peak:.4f} E (closed form 0.5)."
        )
    else:
        shows = "Standard linear solid with E_inf/E_0 = beta = 10: {}."
        computed = (
            "eqs. (1.37), (1.40), (1.42); creep comes from the exact interconversion, whose retardation time is "
            f"{solid.creep_terms()[1][0]:.6f} tau (beta tau = 10 tau by (1.40))."
        )
    return Drawing(
        shows.format("(a) relaxation modulus, (b) creep compliance, (c) complex modulus"), figure, computed=computed
    )
