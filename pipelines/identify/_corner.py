"""The corner plot of an identification: its main quantities against each other."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.identification import Moduli, moduli, sampled_moduli
from labpipe.report import quantity
from pipelines.identify._identify import Identified
from pipelines.identify._result import dataset

_NUISANCES = 3  # that are shown, those that share most with modulus and loss
_RINGS = (1.515, 2.448)  # 68 % and 95 % of two dimensions
_REACH = 3.5  # standard deviations that a panel shows
_MOST_POINTS, _BINS = 600, 20
_WIDEST_NAME = 14  # characters of a line of a label


@dataclass(frozen=True, eq=False)
class MainQuantities:
    """What a reader asks for, normal about its most probable values.

    ``names``: with units, in lines: storage modulus and loss factor where they are known best, and unknowns of the
    experiments; ``centre``, ``covariance`` (n,) (n, n): unknowns of the experiments in standard deviations of their
    prior; ``curve``: modulus and loss factor, at one frequency; ``numbers``: of the unknowns shown.
    """

    names: tuple[str, ...]
    centre: Floats
    covariance: Floats
    curve: Moduli
    numbers: tuple[int, ...]

    def drawn(self, found: Identified) -> Floats:
        """Return them for every draw (draw, n) of the posterior."""
        if found.drawn is None:
            return np.empty((0, len(self.names)))
        draws = found.drawn.draws
        storage, loss = sampled_moduli(found.drawn, found.known, self.curve)
        return np.column_stack([storage / 1e6, loss, draws[:, list(self.numbers)]])


def best_frequency(found: Identified) -> float:
    """Return where the data know modulus and loss factor best [Hz]; in the middle if nowhere."""
    made = dataset(found)
    spread = made["u_ln_storage"].values ** 2 + made["u_ln_loss_factor"].values ** 2
    inside = made["is_determined"].values.astype(bool)
    if not inside.any():
        return float(np.sqrt(made["lowest_frequency"] * made["highest_frequency"]))
    return float(made["frequency"][int(np.argmin(np.where(inside, spread, np.inf)))])


def main_quantities(found: Identified) -> MainQuantities:
    """Choose and gather the quantities of the corner plot."""
    known = found.known
    parameters, xi = known.fit.problem.parameters, known.fit.xi
    frequency = best_frequency(found)
    curve = moduli(known, np.array([frequency]))
    at, loss = float(curve.storage[0]), float(curve.loss_factor[0])
    by_xi = curve.derivatives * np.array([[at / 1e6], [loss]])
    chosen = _related(found, by_xi)
    by_xi = np.vstack([by_xi, np.eye(xi.size)[chosen]])
    covariance = known.covariance_of(by_xi)
    covariance[0, 0] += (at / 1e6 * curve.structure_ln_storage[0]) ** 2
    covariance[1, 1] += (loss * curve.structure_ln_loss_factor[0]) ** 2
    centre = [at / 1e6, loss, *xi[chosen]]
    where = quantity(frequency, "Hz")
    names = (f"E′ / MPa\nat {where}", f"tan δ\nat {where}")
    all_names = (*names, *(_folded(parameters[i].name) for i in chosen))
    return MainQuantities(all_names, np.array(centre, dtype=float), covariance, curve, tuple(chosen))


def _related(found: Identified, by_xi: Floats) -> list[int]:
    """Return the unknowns of the experiments that share most with modulus and loss factor."""
    known = found.known
    parameters = known.fit.problem.parameters
    own = [i for i, p in enumerate(parameters) if p.is_nuisance]
    shared = by_xi @ known.covariance[:, own]
    shared /= np.sqrt(np.diag(known.covariance_of(by_xi)))[:, None] * known.sd[own]
    order = np.argsort(-np.max(np.abs(shared), axis=0), kind="stable")[:_NUISANCES]
    return sorted(own[i] for i in order.tolist())


def _folded(name: str) -> str:
    """Break a long name into lines."""
    lines = [""]
    for word in name.replace("_", "_ ").split(" "):
        if lines[-1] and len(lines[-1]) + len(word) > _WIDEST_NAME:
            lines.append("")
        glue = " " if lines[-1] and not lines[-1].endswith("_") else ""
        lines[-1] += glue + word
    return "\n".join(lines)


def corner(found: Identified) -> bytes:
    """Draw the joint distributions of the main quantities as a PNG file."""
    from matplotlib.figure import Figure

    from labpipe.report import figure_bytes, figure_style

    shown = main_quantities(found)
    points = shown.drawn(found)[:_MOST_POINTS]
    n = len(shown.names)
    with figure_style(columns=2, aspect=1.0):
        figure = Figure()
        axes = figure.subplots(n, n, squeeze=False, sharex="col")
        for i in range(n):
            for j in range(n):
                _panel(axes[i, j], shown, points, i, j)
        figure.align_labels()
        return figure_bytes(figure, "png", 200)


def _panel(panel: Any, shown: MainQuantities, points: Floats, i: int, j: int) -> None:
    """Draw one panel; numbers stand at the left and below only."""
    from labpipe.report import line_arguments

    if j > i:
        panel.set_axis_off()
        return
    reach = _REACH * np.sqrt(np.diag(shown.covariance))
    if i == j:
        x = shown.centre[i] + reach[i] * np.linspace(-1.0, 1.0, 120)
        panel.plot(x, np.exp(-0.5 * np.linspace(-_REACH, _REACH, 120) ** 2), **line_arguments("model"))
        if len(points):
            edges = shown.centre[i] + reach[i] * np.linspace(-1.0, 1.0, _BINS + 1)
            # as high as the bell where the draws are normal
            high = (2.0 * np.pi) ** -0.5 * 2.0 * _REACH / _BINS * len(points)
            panel.hist(points[:, i], edges, alpha=0.3, color="0.4", weights=np.full(len(points), 1.0 / high))
        panel.set_yticks([])
    else:
        turn = np.linspace(0.0, 2.0 * np.pi, 90)
        circle = np.stack([np.cos(turn), np.sin(turn)])
        part = shown.covariance[np.ix_([j, i], [j, i])]
        root = np.linalg.cholesky(part + 1e-12 * np.diag(np.diag(part)))
        for ring in _RINGS:
            panel.plot(*(shown.centre[[j, i], None] + ring * root @ circle), **line_arguments("model"))
        if len(points):
            panel.plot(points[:, j], points[:, i], ".", markersize=1.2, color="0.35", zorder=1)
        panel.set_ylim(shown.centre[i] - reach[i], shown.centre[i] + reach[i])
        panel.locator_params(axis="y", nbins=3)
        if j > 0:
            panel.tick_params(labelleft=False)
    if j > 1:
        panel.axvspan(-1.0, 1.0, alpha=0.08)
    panel.set_xlim(shown.centre[j] - reach[j], shown.centre[j] + reach[j])
    panel.locator_params(axis="x", nbins=3)
    panel.tick_params(axis="x", labelrotation=30)
    if i == len(shown.names) - 1:
        panel.set_xlabel(shown.names[j])
    if j == 0 and i > 0:
        panel.set_ylabel(shown.names[i])
