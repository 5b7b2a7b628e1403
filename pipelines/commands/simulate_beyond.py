"""The command simulate adhesion: a closed form beyond the thesis's limits."""

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
@click.option("--radius", type=quantities.LENGTH, default="9.525 mm", help="Of the sphere.")
@click.option("--work", type=quantities.WORK, default="50 mJ/m2", help="Of adhesion.")
@click.option("--load", type=quantities.FORCE, default="1 N", help="Largest load.")
@quantities.result_options
@json_option
def adhesion(
    material: str,
    temperature: float | None,
    vertical_shift: float,
    radius: float,
    work: float,
    load: float,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
) -> None:
    r"""Load and unload an adhesive sphere slowly, after JKR: force, indentation, pull-off.

    Uses the relaxed (long-time) modulus. Validity: elastic, smooth, quasi-static.

    \b
    Example:
      labpipe simulate adhesion --radius "5 mm" --work "30 mJ/m2" --picture jkr.svg
    """
    from labpipe.contact import adhesive_states
    from pipelines.simulator_inputs import material as load_material

    solid = load_material(material, temperature, vertical_shift)
    found = adhesive_states(solid, radius, work, load, _STATES)
    deliver(found, out, picture, as_json, _adhesion_summary, _adhesion_panels)


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
