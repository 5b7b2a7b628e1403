"""Output of a simulation: netCDF, picture, table or JSON."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.commands.options import echo, echo_json

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.materials import Material, Prony, Thermal

#: Panels: values along both axes and their labels.
Panels = list[tuple[Any, Any, str, str]]
_WIDTH = 34


def deliver(
    found: "xr.Dataset",
    out: Path | None,
    picture: Path | None,
    as_json: bool,
    summary: "Callable[[xr.Dataset], dict[str, Any]]",
    panels: "Callable[[xr.Dataset], Panels]",
) -> None:
    """Write, draw and say what was asked for."""
    from labpipe import files

    document = summary(found)
    if out is not None:
        files.write_dataset(out, found)
        document["netcdf"] = str(out)
    if picture is not None:
        files.write_bytes(picture, _draw(panels(found), picture.suffix.lstrip(".") or "png"))
        document["picture"] = str(picture)
    if as_json:
        echo_json(document)
        return
    units = document.pop("units")
    work = document.pop("work")
    for key, value in document.items():
        text = f"{value:.6g}" if isinstance(value, float) else _row(value)
        echo(f"{key:{_WIDTH}}{text} {units.get(key, '')}".rstrip())
    echo(f"{'work':{_WIDTH}}" + ", ".join(f"{n.replace('_', ' ')} {v}" for n, v in work.items()))


def _row(value: Any) -> str:
    return " ".join(f"{v:.6g}" for v in value) if isinstance(value, list) else str(value)


def _draw(panels: Panels, file_format: str) -> bytes:
    from matplotlib.figure import Figure

    from labpipe.report import figure_bytes, figure_style, line_arguments

    # Dashes tell a model from a measurement; here there is the model only, and it has spikes.
    look = line_arguments("model") | {"linestyle": "-", "linewidth": 1.0}
    with figure_style(columns=1):
        figure = Figure(figsize=(3.35, 1.7 * len(panels)), layout="constrained")
        for row, (x, y, x_label, y_label) in enumerate(panels):
            axes = figure.add_subplot(len(panels), 1, row + 1)
            axes.plot(x, y, **look)
            axes.set(xlabel=x_label, ylabel=y_label)
        return figure_bytes(figure, file_format)


def drop_summary(found: "xr.Dataset", extra: "dict[str, tuple[Any, str]] | None" = None) -> dict[str, Any]:
    """Return what a drop came to: first bounce, all bounces, ledger, extra rows, work."""
    count = found.sizes["impact"]
    document: dict[str, Any] = {"impacts": count}
    units: dict[str, str] = {}
    if count:
        for name in ("restitution", "peak_force", "peak_contact_radius", "contact_duration"):
            key = f"first {name.replace('_', ' ')}"
            document[key] = float(found[name][0])
            units[key] = found[name].attrs["units"].replace("1", "")
        document["impact times"] = [round(float(t), 9) for t in found["impact_time"].values]
        document["restitutions"] = [round(float(e), 6) for e in found["restitution"].values]
        units["impact times"] = "s"
    if "rigid_restitution" in found:
        document["first restitution on a rigid flat"] = float(found["rigid_restitution"])
    ledger, last = "at the end", found.isel(time=-1)
    for name in (
        "kinetic_energy",
        "potential_energy",
        "stored_energy",
        "plate_energy",
        "dissipated_energy",
        "numerical_energy",
    ):
        if name in found:
            document[f"{name.replace('_', ' ')} {ledger}"] = float(last[name])
            units[f"{name.replace('_', ' ')} {ledger}"] = "J"
    if "energy_error" in found.attrs:
        document["energy error"] = float(found.attrs["energy_error"])
    for name, (value, unit) in (extra or {}).items():
        document[name], units[name] = value, unit
    return document | {"units": units, "work": json.loads(found.attrs["work"])}


def adhesion_rows(found: "xr.Dataset", solid: "Prony", work: float) -> dict[str, tuple[Any, str]]:
    """Say whether adhesion matters in the last and the first impact of a drop."""
    from labpipe.contact import adhesion_in_impact
    from labpipe.errors import InputError

    if not found.sizes["impact"]:
        raise InputError("the drop has no completed impact to compare adhesion with")
    impacts = (found[n].values for n in ("impact_speed", "contact_duration", "peak_force"))
    seen = [
        adhesion_in_impact(solid, float(found["sphere_radius"]), float(found["mass"]), speed, duration, force, work)
        for speed, duration, force in zip(*impacts, strict=True)
    ]
    first = seen[0]
    some = [i + 1 for i, one in enumerate(seen) if one.verdict != "negligible"]
    verdict = "negligible" if not some else f"may matter from impact {some[0]} on"
    return {
        "adhesion": (verdict, ""),
        "adhesion pull-off force": (first.pull_off, "N"),
        "adhesion pull-off force at most": (first.pull_off_bound, "N"),
        "adhesion of the first peak force": (first.force_share, ""),
        "adhesion regime": (f"{first.regime}, Tabor {first.tabor:.3g}", ""),
    }


def heating_rows(
    found: "xr.Dataset", material: "Material", thermal: "Thermal", temperature: float | None
) -> dict[str, tuple[Any, str]]:
    """Say by how much a drop warms its contact, and what that does to the modulus."""
    import numpy as np

    from labpipe.contact import NOTICEABLE, self_heating

    estimate = self_heating(found, material, thermal, temperature)
    over = np.flatnonzero(np.abs(estimate.dataset["modulus_change"].values) >= NOTICEABLE)
    since = f" from impact {over[0] + 1} on" if over.size else ""
    return {
        "self-heating": (f"{estimate.verdict}{since}", ""),
        "self-heating by the first impact": (float(estimate.dataset["bulk_rise"][0]), "K"),
        "self-heating after all impacts": (estimate.train, "K"),
        "self-heating without conduction": (estimate.train_adiabatic, "K"),
        "self-heating if all heat were from friction": (estimate.surface, "K"),
        "change of modulus by heating": (estimate.modulus_change, ""),
        "thermal properties": (f"{thermal.status}: {thermal.source}", ""),
    }


def drop_panels(found: "xr.Dataset") -> Panels:
    """Return the height over time, and force and radius of the first contact."""
    import numpy as np

    ms = found["time"].values * 1e3
    panels: Panels = [(ms, found["displacement"].values * 1e3, "time / ms", "height / mm")]
    near, since, label = np.full(ms.size, True), ms, "time / ms"
    if found.sizes["impact"]:
        start = float(found["impact_time"][0])
        end = start + 1.1 * float(found["contact_duration"][0])
        near = (found["time"].values >= start) & (found["time"].values <= end)
        since, label = ms[near] - start * 1e3, "time since first touch / ms"
    return [
        *panels,
        (since, found["force"].values[near], label, "force / N"),
        (since, found["contact_radius"].values[near] * 1e3, label, "contact radius / mm"),
    ]


def indent_summary(found: "xr.Dataset") -> dict[str, Any]:
    """Return what an indentation came to: forces, width, ledger, solver, work."""
    document: dict[str, Any] = {
        "peak force": float(found["force"].max()),
        "final force": float(found["force"][-1]),
        "largest contact half-width": float(found["contact_half_width"].max()),
        "work done": float(found["work_done"][-1]),
        "stored energy": float(found["stored_energy"][-1]),
        "dissipated energy": float(found["dissipated_energy"][-1]),
        "energy error": float(found.attrs["energy_error"]),
        "solver": str(found.attrs["solver"]),
        "solver reason": str(found.attrs["solver_reason"]),
        "datum": str(found.attrs["datum"]),
    }
    units = {"peak force": "N", "final force": "N", "largest contact half-width": "m"}
    units |= dict.fromkeys(("work done", "stored energy", "dissipated energy"), "J")
    return document | {"units": units, "work": json.loads(found.attrs["work"])}


def indent_panels(found: "xr.Dataset") -> Panels:
    """Return the force over time and over the displacement."""
    um = found["displacement"].values * 1e6
    return [
        (found["time"].values, found["force"].values, "time / s", "force / N"),
        (um, found["force"].values, "displacement / µm", "force / N"),
    ]
