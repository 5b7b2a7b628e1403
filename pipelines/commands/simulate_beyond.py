"""Commands simulate adhesion and simulate amplitude: closed forms beyond the thesis's limits."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipelines.commands import quantities
from pipelines.commands.options import json_option
from pipelines.commands.simulation_output import Panels, deliver

if TYPE_CHECKING:
    import xarray as xr

_STATES = 200


@click.command()
@quantities.material_options("nbr")
@click.option("--shape", type=click.Choice(["parabola", "sphere", "cone"]), default="parabola", help="Of the indenter.")
@click.option("--radius", type=quantities.LENGTH, default="9.525 mm", help="Of parabola and sphere.")
@click.option("--slope", type=float, default=0.1, help="Of the cone's flank.")
@click.option("--work", type=quantities.WORK, default="50 mJ/m2", help="Of adhesion.")
@click.option("--distance", type=quantities.LENGTH, default="0.3 nm", help="Equilibrium distance of the surfaces.")
@click.option("--load", type=quantities.FORCE, default="1 N", help="Largest load.")
@click.option(
    "--theory",
    type=click.Choice(["jkr", "maugis"]),
    default="jkr",
    help="Edge stress: singular (JKR), or constant (Maugis–Dugdale).",
)
@quantities.result_options
@json_option
def adhesion(
    material: str,
    temperature: float | None,
    vertical_shift: float,
    shape: str,
    radius: float,
    slope: float,
    work: float,
    distance: float,
    load: float,
    theory: str,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
) -> None:
    r"""Load and unload an adhesive contact slowly: force, indentation, pull-off.

    Uses the relaxed (long-time) modulus. Validity: elastic, smooth, quasi-static.

    \b
    Example:
      labpipe simulate adhesion --radius "5 mm" --work "30 mJ/m2" --picture jkr.svg
    """
    from labpipe.contact.beyond import adhesive_states
    from pipelines.simulator_inputs import material as load_material

    solid = load_material(material, temperature, vertical_shift)
    found = adhesive_states(
        solid, shape, slope if shape == "cone" else radius, work, load, distance, theory=theory, states=_STATES
    )
    deliver(found, out, picture, as_json, _adhesion_summary, _adhesion_panels)


@click.command()
@quantities.material_options("nbr")
@quantities.punch_options
@click.option("--frequency", type=quantities.FREQUENCY, default="1 Hz", help="Of the oscillation.")
@click.option("--least", type=quantities.LENGTH, default="10 nm", help="Smallest amplitude.")
@click.option("--most", type=quantities.LENGTH, default="10 um", help="Largest amplitude.")
@click.option("--critical-strain", type=float, default=0.01, help="Shear strain amplitude at half of the decrease.")
@click.option(
    "--storage-floor", type=float, required=True, help="Storage modulus at large strain over the linear one, 0 to 1."
)
@click.option("--loss-peak", type=float, default=1.0, help="Loss modulus at the critical strain over the linear one.")
@click.option("--loss-floor", type=float, default=1.0, help="Loss modulus at large strain over the linear one.")
@click.option("--exponent", type=float, default=0.6, help="Kraus's m.")
@quantities.result_options
@json_option
def amplitude(
    material: str,
    temperature: float | None,
    vertical_shift: float,
    tip_radius: float,
    period: float,
    depth: float,
    mean: float,
    frequency: float,
    least: float,
    most: float,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
    **softening: float,
) -> None:
    r"""Oscillate a punch on a filled rubber that softens with the amplitude (Kraus).

    Validity: steady state, first harmonic, one representative strain, permanent contact.

    \b
    Example:
      labpipe simulate amplitude --storage-floor 0.4 --loss-peak 1.5 --picture payne.svg
    """
    import numpy as np

    from labpipe import contact
    from labpipe.materials import Kraus
    from pipelines.simulator_inputs import material as load_material

    if not 0.0 < least < most:
        raise click.UsageError("--least and --most: expected 0 < least < most")
    solid = load_material(material, temperature, vertical_shift)
    amplitudes, softened = np.geomspace(least, most, _STATES), Kraus(**softening)
    found = contact.amplitude_sweep(solid, softened, frequency, amplitudes, mean, tip_radius, period, depth)
    deliver(found, out, picture, as_json, _amplitude_summary, _amplitude_panels)


def _adhesion_summary(found: "xr.Dataset") -> dict[str, Any]:
    names = ("pull_off", "tabor", "lost_energy", "reduced_modulus")
    known = [name for name in names if name in found]
    document: dict[str, Any] = {str(found[name].attrs["long_name"]): float(found[name]) for name in known}
    units = {str(found[name].attrs["long_name"]): str(found[name].attrs["units"]).replace("1", "") for name in known}
    for name in ("theory", "regime", "validity"):
        if name in found.attrs:
            document[name] = found.attrs[name]
    return document | {"units": units, "work": {"states": found.sizes["state"]}}


def _adhesion_panels(found: "xr.Dataset") -> Panels:
    um = found["indentation"].values * 1e6
    width = found["contact_radius"].values * 1e6
    return [
        (um, found["force"].values, "indentation / µm", "force / N"),
        (width, found["force"].values, "contact radius / µm", "force / N"),
    ]


def _amplitude_summary(found: "xr.Dataset") -> dict[str, Any]:
    document: dict[str, Any] = {}
    units: dict[str, str] = {}
    for place, where in ((0, "smallest"), (-1, "largest")):
        for name in ("strain", "storage_stiffness", "loss_stiffness", "work_per_cycle"):
            key = f"{name.replace('_', ' ')}, {where} swing"
            document[key] = float(found[name][place])
            units[key] = str(found[name].attrs["units"]).replace("1", "")
    document["punch loses contact beyond"] = float(found.attrs["tapping_amplitude"])
    units["punch loses contact beyond"] = "m"
    return document | {"units": units, "work": {"amplitudes": found.sizes["amplitude"]}}


def _amplitude_panels(found: "xr.Dataset") -> Panels:
    percent = found["strain"].values * 100.0
    return [
        (percent, found["storage_stiffness"].values, "shear strain / %", "storage stiffness / N/m"),
        (percent, found["loss_stiffness"].values, "shear strain / %", "loss stiffness / N/m"),
    ]
