"""Settings of a static loading: a sphere on a disc, masses added to the holder one by one."""

from itertools import accumulate, pairwise
from typing import Annotated, Literal

import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import NOT_NEGATIVE, POSITIVE, File, Length, Mass, Time
from pipelines.experiments.shared.settings import Flat, MaterialChoice, OfLaser, SphereModel, Table


class Load(Table, frozen=True, kw_only=True):
    """One load."""

    mass: Annotated[Mass, POSITIVE]  #: all that rests on the disc, holder included
    time: Annotated[Time, NOT_NEGATIVE] | None = None  #: when it was put on, from the first point; else searched for


class Ball(MaterialChoice, frozen=True, kw_only=True):
    """The sphere."""

    radius: Annotated[Length, POSITIVE]  #: radius of the sphere


class Steps(Table, frozen=True, kw_only=True):
    """Which readings count."""

    settle: Annotated[Time, NOT_NEGATIVE] = Quantity(10.0, 0.0, "s")  #: left out after a step: a hand is near
    window: Annotated[Time, POSITIVE] = Quantity(60.0, 0.0, "s")  #: over which levels are means
    search: Annotated[Time, POSITIVE] = Quantity(60.0, 0.0, "s")  #: how far a step may be from the time given for it
    drift: Annotated[Length, NOT_NEGATIVE] = Quantity(0.0, 0.0, "m")  #: u of the zero, which wanders over the record


class StaticLoading(OfLaser, frozen=True, kw_only=True):
    """One record of the laser while loads are added; the first is on from the beginning.

    First touch follows from the loads: the approach goes with the power 2/3 of load and compliance, and loads of
    different size determine it.
    """

    kind: Literal["static_loading"]
    laser: File  #: the recording
    sphere: Ball  #: the loaded body
    counter_body: Flat = "sapphire"  #: the disc
    loads: Annotated[list[Load], msgspec.Meta(min_length=2)]  #: the loads in their order
    steps: Steps = Steps()  #: which readings count
    model: SphereModel = SphereModel()  #: the simulation

    def __post_init__(self) -> None:
        """Refuse loads that fall, and times that run backwards."""
        masses = [load.mass.value for load in self.loads]
        if any(b <= a for a, b in pairwise(masses)):
            stated, added = (", ".join(f"{m:g} kg" for m in each) for each in (masses, accumulate(masses)))
            remedy = f"if each is what was added, the totals to state are {added}"
            for i in range(len(masses) - 1):
                swapped = [*masses[:i], masses[i + 1], masses[i], *masses[i + 2 :]]
                if all(a < b for a, b in pairwise(swapped)):
                    remedy = f"loads {i + 1} and {i + 2} are probably exchanged"
            text = "loads: every mass is all that rests on the disc, so each must exceed the one before; found "
            raise ValueError(f"{text}{stated}; {remedy}")
        times = [load.time.value for load in self.loads if load.time is not None]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"loads: times must grow from load to load; found {', '.join(f'{t:g} s' for t in times)}")
