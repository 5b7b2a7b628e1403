"""Commands that run the bundled simulator alone: simulate drop, indent, adhesion; sweep."""

import json
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from pipelines.commands.options import NEW_FILE, cluster_option, emit, json_option
from pipelines.commands.progress import progress
from pipelines.sweeps.simulators import SIMULATORS

if TYPE_CHECKING:
    import xarray as xr

F = TypeVar("F", bound=Callable[..., Any])
_Rows = list[tuple[str, Any, str]]
"""Name, value and unit."""
_Panels = list[tuple[Any, Any, str, str]]
"""Values along both axes and their labels."""
_Simulated = tuple["xr.Dataset", _Rows, _Panels]
_SHOWN = 5


def value_option(name: str, unit: str, text: str, **more: Any) -> Callable[[F], F]:
    """Add an option that takes a number with a unit, and hands it on in SI; a text where the unit is empty."""

    def in_si(context: click.Context, option: click.Parameter, given: Any) -> float | None:
        from labpipe.errors import InputError
        from labpipe.units import si

        try:
            return None if given is None else si(given, unit, str(option.name))
        except InputError as error:
            raise click.BadParameter(str(error), context, option) from None

    shown: dict[str, Any] = {"callback": in_si, "metavar": "QUANTITY"} if unit else {}
    return click.option(name, help=text, **shown, **more)


def _simulation(simulator: str, *names: str) -> Callable[[Callable[..., _Simulated]], click.Command]:
    """Make a command of a function that simulates, and write and draw its result as wanted.

    Options of the material, its temperature and shift, and of the named parameters are those of a sweep.
    """
    known = SIMULATORS[simulator].parameters

    def made(function: Callable[..., _Simulated]) -> click.Command:
        @click.option("--out", type=NEW_FILE, help="netCDF file to write.")
        @click.option("--picture", type=NEW_FILE, help="Picture to draw (.png, .svg or .pdf).")
        @json_option
        @wraps(function)
        def command(*, out: Path | None, picture: Path | None, **options: Any) -> None:
            _deliver(*function(**options), out, picture)

        for name in ("material", "temperature", "vertical_shift", *names)[::-1]:
            one = known[name]
            text = f"{one.text[:1].upper()}{one.text[1:]}."
            command = value_option(f"--{name.replace('_', '-')}", one.unit, text, default=one.default)(command)
        return simulate.command()(command)

    return made


@click.group()
def simulate() -> None:
    r"""Run the bundled viscoelastic simulator.

    \b
    Example:
      labpipe simulate drop --height "1.5 mm" --picture drop.png
    """


@_simulation("drop", "radius", "mass", "height", "rtol", "plate_mass", "plate_frequency", "plate_damping")
@value_option("--duration", "s", "From release.", default="0.5 s")
@click.option("--solver", type=click.Choice(["mdr", "rings", "thesis"]), default="mdr",
              help="'thesis' is the thesis's own scheme.")  # fmt: skip
@click.option("--profile", type=click.Choice(["parabola", "sphere"]), default="parabola", help="Shape of the gap.")
@click.option("--substrate", help='Elastic counter-body: "sapphire", or modulus and Poisson\'s ratio, "70 GPa, 0.22".')
@value_option("--adhesion", "J/m2", 'Estimate whether adhesion matters: work of adhesion, "50 mJ/m2" when clean.')
@click.option("--heating", is_flag=True, help="Estimate self-heating.")
@value_option("--heat-capacity", "J/kg/K", "For --heating; default: from the library.")
@value_option("--conductivity", "W/m/K", "For --heating; default: from the library.")
def drop(material: str, temperature: float | None, vertical_shift: float, **options: Any) -> _Simulated:
    r"""Drop a viscoelastic sphere on a flat (rigid by default) or on a vibrating plate.

    \b
    Example:
      labpipe simulate drop --material ptfe --height "7 mm" --substrate sapphire --out drop.nc
    """
    import numpy as np

    from labpipe import contact
    from labpipe.errors import InputError
    from labpipe.materials import describe
    from pipelines.simulator_inputs import material as load, thermal_of

    of_plate = [options.pop(f"plate_{name}") for name in ("mass", "frequency", "damping")]
    plate = contact.Plate(*of_plate) if of_plate[0] else None
    if options["substrate"] and "," in options["substrate"]:
        options["substrate"] = tuple(options["substrate"].split(",", 1))
    work, is_heated = options.pop("adhesion"), options.pop("heating")
    properties = [options.pop(name) for name in ("heat_capacity", "conductivity")]
    solid = load(material, temperature, vertical_shift)
    with progress(text="simulating", total=1.0) as shown:
        found = contact.drop(solid, **options, plate=plate, progress=shown)
    n, last = found.sizes["impact"], found.isel(time=-1)
    of_first = ("restitution", "peak_force", "peak_contact_radius", "contact_duration")
    rows: _Rows = [("impacts", n, "")]
    rows += [(f"first {_said(name)}", float(found[name][0]), _unit(found[name])) for name in of_first if n]
    lists = (("impact times", "impact_time", 9, "s"), ("restitutions", "restitution", 6, ""))
    rows += [(name, found[of].values.round(digits).tolist(), unit) for name, of, digits, unit in lists if n]
    if "rigid_restitution" in found:
        rows.append(("first restitution on a rigid flat", float(found["rigid_restitution"]), ""))
    energies = [f"{name}_energy" for name in ("kinetic", "potential", "stored", "plate", "dissipated", "numerical")]
    rows += [(f"{_said(name)} at the end", float(last[name]), "J") for name in energies if name in found]
    rows += [("energy error", float(found.attrs["energy_error"]), "")] if "energy_error" in found.attrs else []
    if work is not None:
        if not n:
            raise InputError("the drop has no completed impact to compare adhesion with")
        impacts = (found[name].values for name in ("impact_speed", "contact_duration", "peak_force"))
        radius, mass = float(found["sphere_radius"]), float(found["mass"])
        seen = [
            contact.adhesion_in_impact(solid, radius, mass, speed, duration, force, work)
            for speed, duration, force in zip(*impacts, strict=True)
        ]
        some, first = [i for i, one in enumerate(seen, 1) if one.verdict != "negligible"], seen[0]
        rows += [
            ("adhesion", f"may matter from impact {some[0]} on" if some else "negligible", ""),
            ("adhesion pull-off force", first.pull_off, "N"),
            ("adhesion pull-off force at most", first.pull_off_bound, "N"),
            ("adhesion of the first peak force", first.force_share, ""),
            ("adhesion regime", f"{first.regime}, Tabor {first.tabor:.3g}", ""),
        ]
    if is_heated:
        thermal = thermal_of(material, *properties)
        heat = contact.self_heating(found, describe(material), thermal, temperature)
        change = heat["modulus_change"].values
        over = np.flatnonzero(np.abs(change) >= contact.NOTICEABLE)
        rows += [
            ("self-heating", f"{heat.attrs['verdict']}{f' from impact {over[0] + 1} on' if over.size else ''}", ""),
            ("self-heating by the first impact", float(heat["bulk_rise"][0]), "K"),
            ("self-heating after all impacts", float(heat["train_rise"].max()), "K"),
            ("self-heating without conduction", float(heat["train_rise_adiabatic"].max()), "K"),
            ("change of modulus by heating", float(max(change, key=abs)), ""),
            ("thermal properties", f"{thermal.status}: {thermal.source}", ""),
        ]
    start = float(found["impact_time"][0]) if n else 0.0
    end = start + 1.1 * float(found["contact_duration"][0]) if n else np.inf
    near = found.sel(time=slice(start, end))
    since = "time since first touch / ms" if n else "time / ms"
    panels = [
        (found["time"] * 1e3, found["displacement"] * 1e3, "time / ms", "height / mm"),
        ((near["time"] - start) * 1e3, near["force"], since, "force / N"),
        ((near["time"] - start) * 1e3, near["contact_radius"] * 1e3, since, "contact radius / mm"),
    ]
    return found, rows, panels


@_simulation("indent", "tip_radius", "period", "depth", "mean", "amplitude", "frequency", "hold", "ramp", "profile")
@click.option("--cycles", type=click.IntRange(min=0), default=5, help="Number of cycles; 0 for press and hold only.")
@value_option("--thickness", "m", "Thickness of a bonded layer; default: half-plane.")
@click.option("--elements", type=click.IntRange(min=64), default=1024, help="Strips per period.")
@click.option("--maps", is_flag=True, help="Store pressure and surface at every sample.")
def indent(
    material: str, temperature: float | None, vertical_shift: float, thickness: float | None, maps: bool, **options: Any
) -> _Simulated:
    r"""Press a periodic punch into a surface: ramp, hold, then oscillate.

    \b
    Example:
      labpipe simulate indent --frequency "2 Hz" --picture loops.png
    """
    import numpy as np

    from labpipe import contact
    from pipelines.simulator_inputs import material as load, ramp_hold_oscillation

    moves = {name: options.pop(name) for name in ("mean", "amplitude", "frequency", "cycles", "hold", "ramp")}
    time, moved = ramp_hold_oscillation(**moves, per_cycle=100)
    with progress(text="simulating", total=1.0) as shown:
        found = contact.indent(
            load(material, temperature, vertical_shift),
            time=time,
            displacement=moved,
            thickness=np.inf if thickness is None else thickness,
            outputs=("energy", "pressure", "surface") if maps else ("energy",),
            progress=shown,
            **options,
        )
    last = found.isel(time=-1)
    rows: _Rows = [
        ("peak force", float(found["force"].max()), "N"),
        ("final force", float(last["force"]), "N"),
        ("largest contact half-width", float(found["contact_half_width"].max()), "m"),
        *((_said(name), float(last[name]), "J") for name in ("work_done", "stored_energy", "dissipated_energy")),
        ("energy error", float(found.attrs["energy_error"]), ""),
        *((_said(name), str(found.attrs[name]), "") for name in ("solver", "datum")),
    ]
    panels = [
        (found["time"], found["force"], "time / s", "force / N"),
        (found["displacement"] * 1e6, found["force"], "displacement / µm", "force / N"),
    ]
    return found, rows, panels


@_simulation("indent")
@value_option("--radius", "m", "Of the sphere.", default="9.525 mm")
@value_option("--work", "J/m2", "Of adhesion.", default="50 mJ/m2")
@value_option("--load", "N", "Largest load.", default="1 N")
def adhesion(radius: float, work: float, load: float, **of_material: Any) -> _Simulated:
    r"""Load and unload an adhesive sphere slowly, after JKR: force, indentation, pull-off.

    Uses the relaxed (long-time) modulus. Validity: elastic, smooth, quasi-static.

    \b
    Example:
      labpipe simulate adhesion --radius "5 mm" --work "30 mJ/m2" --picture jkr.svg
    """
    from labpipe.contact import adhesive_states
    from pipelines.simulator_inputs import material as solid_of

    found = adhesive_states(solid_of(of_material.pop("material"), **of_material), radius, work, load)
    known = [found[n] for n in ("pull_off", "tabor", "lost_energy", "reduced_modulus") if n in found]
    rows: _Rows = [(v.attrs["long_name"], float(v), _unit(v)) for v in known]
    rows += [(name, found.attrs[name], "") for name in ("theory", "regime", "validity") if name in found.attrs]
    axes = ("indentation", "contact_radius")
    return found, rows, [(found[name] * 1e6, found["force"], f"{_said(name)} / µm", "force / N") for name in axes]


@click.command()
@click.argument("simulator", type=click.Choice(list(SIMULATORS)))
@click.option("--vary", multiple=True, metavar="NAME=VALUES",
              help='"height = 1 mm : 10 mm : 7", ": log" for equal ratios, or a list.')  # fmt: skip
@click.option("--set", "fixed", multiple=True, metavar="NAME=VALUE",
              help='A fixed parameter; with "±" and --draws it is sampled.')  # fmt: skip
@click.option("--draws", type=click.IntRange(min=0), default=0, help="Random draws per point.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Seed of the draws.")
@click.option("--out", required=True, type=NEW_FILE, help="netCDF file; the page is written beside it.")
@click.option("--jobs", "-j", type=click.IntRange(min=0), default=1, help="Local processes; 0 for one per processor.")
@cluster_option
@json_option
def sweep(simulator: str, vary: tuple[str, ...], fixed: tuple[str, ...], out: Path, **options: Any) -> None:
    r"""Simulate every combination of some parameters; write one netCDF file and a page.

    The same command resumes a stopped sweep and retries failed points. The result does not depend
    on where it is computed.

    \b
    Example:
      labpipe sweep drop --vary "material = acrylic, ptfe" --vary "height = 1 mm : 10 mm : 7" \
          --set "radius = 9.525 ± 0.005 mm" --draws 20 --out heights.nc
    """
    from pipelines.sweeps import sweep as verb

    varied, constants = _named(vary), _named(fixed)
    with progress(text="simulating", total=1.0) as shown:
        swept = verb(simulator, out, vary=varied, fixed=constants, progress=shown, **options)
    counts = {"computed": swept.computed, "reused": swept.reused, "failed": swept.failed}
    lines = (swept.summary, f"results: {out}", f"page: {swept.page}")
    emit({"netcdf": str(out), "page": str(swept.page)} | counts, lines, code=1 if swept.failed else 0)


def _named(texts: Iterable[str]) -> dict[str, str]:
    """Split NAME=VALUE, and refuse a name that comes twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name or not value:
            raise click.UsageError(f'"{text}": expected NAME=VALUE, such as "height=1.5 mm"')
        if name in found:
            raise click.UsageError(f"{name} is set twice")
        found[name] = value
    return found


def _deliver(found: "xr.Dataset", rows: _Rows, panels: _Panels, out: Path | None, picture: Path | None) -> None:
    """Write and draw a simulation as wanted, and print its rows; in JSON with its work."""
    from labpipe import files
    from labpipe.report import quantity

    work = json.loads(found.attrs.get("work", "{}"))
    if out is not None:
        files.write_dataset(out, found)
        rows.append(("netcdf", str(out), ""))
    if picture is not None:
        from matplotlib.figure import Figure

        from labpipe.report import figure_bytes, figure_style, line_arguments

        # Dashes mark a model beside a measurement; here there is the model only, and it has spikes.
        look = line_arguments("model") | {"linestyle": "-", "linewidth": 1.0}
        with figure_style(columns=1):
            figure = Figure(figsize=(3.35, 1.7 * len(panels)), layout="constrained")
            for row, (x, y, x_label, y_label) in enumerate(panels, 1):
                axes = figure.add_subplot(len(panels), 1, row, xlabel=x_label, ylabel=y_label)
                axes.plot(x, y, **look)
            files.write_bytes(picture, figure_bytes(figure, picture.suffix.lstrip(".") or "png"))
        rows.append(("picture", str(picture), ""))

    def text(value: Any, unit: str) -> str:
        return str(value) if not isinstance(value, float) else quantity(value, unit, 4) if unit else f"{value:.4g}"

    units = {name: unit for name, _, unit in rows if unit}
    lists = [(name.removeprefix("impact ")[:-1], value, unit) for name, value, unit in rows if isinstance(value, list)]
    width = 2 + max(len(name) for name, _, _ in rows)
    lines = [f"{name:{width}}{text(value, unit)}" for name, value, unit in rows if not isinstance(value, list)]
    impacts = list(zip(*([f"{name} {text(v, unit)}" for v in own] for name, own, unit in lists), strict=True))
    lines += [f"{f'impact {i}':{width}}{', '.join(own)}" for i, own in enumerate(impacts[:_SHOWN], 1)]
    lines += [f"impacts {_SHOWN + 1} to {len(impacts)}: with --json"] if len(impacts) > _SHOWN else []
    emit({name: value for name, value, _ in rows} | {"units": units, "work": work}, lines)


def _said(name: str) -> str:
    return name.replace("_", " ")


def _unit(variable: "xr.DataArray") -> str:
    return str(variable.attrs["units"]).replace("1", "")
