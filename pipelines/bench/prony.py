"""Fit of a Prony series: error against run time over the density of its terms."""

from collections.abc import Callable, Mapping

import numpy as np

from labpipe.arrays import Complexes
from labpipe.materials import TERMS_PER_DECADE, compress, make_grid, maxwell_shapes, solve_by_cross_validation
from pipelines.bench import rheology_peers
from pipelines.bench.measure import Extra, Suite, Timing, race
from pipelines.bench.rheology_truth import FRACTIONAL, MAXWELL, Measured, Truth, measured

_SEED = 700
_DENSITIES = (1, 2, 3, 4, 6)


def run(quick: bool) -> tuple[Suite, ...]:
    """Fit sweeps whose true shifts are given, at several densities and by peers."""
    return (_suite("prony", MAXWELL, quick), _suite("prony-fractional", FRACTIONAL, quick))


def _suite(name: str, truth: Truth, quick: bool) -> Suite:
    made = measured(truth, _SEED)
    calls: dict[str, tuple[str, Callable[[], object]]] = {}
    for density in _DENSITIES:
        calls[f"{density} terms/decade"] = ("", _fit(made, density, is_plain=False))
    calls["3 terms/decade, no smoothing, no bounds"] = ("least squares", _fit(made, TERMS_PER_DECADE, is_plain=True))
    if not quick:
        calls |= rheology_peers.prony_fitters(made)

    def judge(label: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        ratio = np.asarray(timings[label].value) - made.exact
        storage, loss = ratio.real / made.exact.real, ratio.imag / made.exact.imag
        return 100.0 * float(np.sqrt(np.mean(np.concatenate([storage, loss]) ** 2))), {
            "storage, worst (%)": 100.0 * float(np.max(np.abs(storage))),
            "loss, worst (%)": 100.0 * float(np.max(np.abs(loss))),
        }

    default = f"{TERMS_PER_DECADE} terms/decade"
    points = race(calls, 3 if quick else 15, judge, default, budget=20.0, traced=calls)
    notes = ["true shifts given; 2 % noise on both moduli; error against the noise-free moduli"]
    notes += ["peers are left out of the quick run"] if quick else rheology_peers.missing()[:1]
    return Suite(
        name, f"Series through the moduli of {truth.name}", "RMS relative error of both moduli (%)", points, notes=notes
    )


def _fit(made: Measured, density: int, *, is_plain: bool) -> Callable[[], Complexes]:
    """Return a call that fits and gives the moduli at the measured points."""
    frequency = made.sweeps["frequency"].values
    ln_omega = np.log(2.0 * np.pi * frequency * 10.0 ** made.log10_aT[:, None]).ravel()
    storage, loss = (made.sweeps[name].values.ravel() for name in ("storage", "loss"))

    def fitted() -> Complexes:
        grid = make_grid(ln_omega, storage, loss, terms_per_decade=density)
        first, second = maxwell_shapes(ln_omega, grid.ln_time)
        ones = np.ones((ln_omega.size, 1))
        design = np.vstack([np.hstack([first, ones]), np.hstack([second, 0.0 * ones])])
        design *= grid.scale
        size = np.concatenate([storage, loss])
        rows, target = design / size[:, None], np.ones(size.size)
        if is_plain:
            coefficient = np.linalg.lstsq(rows, target, rcond=None)[0]
        else:
            system = compress(rows, target)
            coefficient = solve_by_cross_validation(*system, grid.penalty, size.size).coefficient
        values = design @ coefficient
        half = ln_omega.size
        return np.asarray(values[:half] + 1j * values[half:]).reshape(made.exact.shape)

    return fitted
