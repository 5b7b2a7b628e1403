"""Beyond the thesis: adhesion, self-heating, and moduli that depend on the amplitude of strain."""

from labpipe.contact.beyond._adhesion import (
    cohesive_stress,
    dmt,
    jkr,
    jkr_at_force,
    lost_energy,
    maugis,
    maugis_parameter,
    pull_off,
    tabor,
)
from labpipe.contact.beyond._adhesion_estimate import AdhesionEstimate, adhesion_in_impact
from labpipe.contact.beyond._adhesive_mdr import adhesive_indentation, adhesive_pull_off
from labpipe.contact.beyond._adhesive_states import adhesive_states
from labpipe.contact.beyond._amplitude import amplitude_sweep
from labpipe.contact.beyond._heating import NOTICEABLE, Heating, flash_temperature, self_heating

__all__ = [
    "NOTICEABLE",
    "AdhesionEstimate",
    "Heating",
    "adhesion_in_impact",
    "adhesive_indentation",
    "adhesive_pull_off",
    "adhesive_states",
    "amplitude_sweep",
    "cohesive_stress",
    "dmt",
    "flash_temperature",
    "jkr",
    "jkr_at_force",
    "lost_energy",
    "maugis",
    "maugis_parameter",
    "pull_off",
    "self_heating",
    "tabor",
]
