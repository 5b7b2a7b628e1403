"""Proposals of ``init``: slowly sampled laser exports are static loadings."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import laser_record


@proposals.of_groups(
    proposals.without_repeat, lambda found, names: names if proposals.is_slow(found.path(names[0])) else []
)
def proposed(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for slow readings."""
    return f"""[experiments.{name}]
kind = "static_loading"  # proposed because the readings are slow
laser = "{proposals.quoted(files[0])}"
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, with its uncertainty

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.material_line(files[0], found)}

[[experiments.{name}.loads]]  # on from the beginning
mass = "{GAP} kg"  # all that rests on the disc, holder included, with ±, e.g. "0.500 ± 0.001 kg"

[[experiments.{name}.loads]]  # one such table for each further load
mass = "{GAP} kg"  # all that rests on the disc then, with ±
# time = "2.55 min"  # when it was put on; without it the record is searched"""
