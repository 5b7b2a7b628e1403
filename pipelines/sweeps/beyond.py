"""Simulators beyond the thesis: adhesion and self-heating."""

from collections.abc import Mapping

from pipelines.simulator_inputs import thermal_of
from pipelines.sweeps.parameters import FALL, RUBBER, Outputs, Parameter, Simulator, Value, numbers, solid


def adhesion(point: Mapping[str, Value]) -> Outputs:
    """Adhesion of a sphere after JKR, with the relaxed modulus."""
    from labpipe import contact
    from labpipe.contact import lost_energy

    number, material = numbers(point), solid(point)
    modulus = material.factor("contact") * material.E_relaxed
    sphere = (number["radius"], modulus, number["work"])
    return {
        "pull_off": contact.pull_off(*sphere),
        "radius_at_no_load": float(contact.jkr_at_force(0.0, *sphere).contact_radius),
        "tabor": contact.tabor(*sphere, number["distance"]),
        "lost_energy": lost_energy(*sphere),
    }


def heating(point: Mapping[str, Value]) -> Outputs:
    """Self-heating of a train of bounces."""
    from labpipe import contact
    from labpipe.materials import describe

    number, material = numbers(point), describe(str(point["material"]))
    radius, mass, height, duration = (number[name] for name in ("radius", "mass", "height", "duration"))
    rtol, gravity = number["rtol"], number["gravity"]
    drop = contact.drop(solid(point), radius, mass, height, duration, rtol=rtol, gravity=gravity)
    thermal = thermal_of(str(point["material"]), number.get("heat_capacity"), number.get("conductivity"))
    found = contact.self_heating(drop, material, thermal, number.get("temperature"))
    return {
        "impacts": float(drop.sizes["impact"]),
        "bulk_rise": float(found.dataset["bulk_rise"][0]),
        "train_rise": found.train,
        "train_rise_adiabatic": found.train_adiabatic,
        "modulus_change": found.modulus_change,
    }


BEYOND = {
    "adhesion": Simulator(
        adhesion,
        {
            **RUBBER,
            "radius": Parameter("m", 9.525e-3, "of the sphere"),
            "work": Parameter("J/m2", 0.05, "of adhesion"),
            "distance": Parameter("m", 0.3e-9, "equilibrium distance of the surfaces"),
        },
        {
            "pull_off": ("N", "Pull-off force"),
            "radius_at_no_load": ("m", "Contact radius without load"),
            "tabor": ("1", "Tabor's parameter"),
            "lost_energy": ("J", "Energy lost, closing and opening"),
        },
    ),
    "heating": Simulator(
        heating,
        {
            **FALL,
            "duration": Parameter("s", 0.5, "from the release"),
            "heat_capacity": Parameter("J/kg/K", None, "without it, the library's"),
            "conductivity": Parameter("W/m/K", None, "without it, the library's"),
            "rtol": Parameter("1", 1e-3, "relative error aimed at"),
        },
        {
            "impacts": ("1", "Impacts"),
            "bulk_rise": ("K", "Rise of the contact by the first impact"),
            "train_rise": ("K", "Largest rise, with conduction"),
            "train_rise_adiabatic": ("K", "Largest rise, without conduction"),
            "modulus_change": ("1", "Relative change of the modulus"),
        },
    ),
}
"""Keys as ``labpipe sweep`` names them."""
