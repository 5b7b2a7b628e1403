"""A few sweeps of the virtual rheometer, and what a session would state of its solids."""

from typing import Any

import msgspec
import numpy as np

from labpipe.units import Quantity
from pipelines.experiments.dma.settings import Dma
from pipelines.rig.dma import Protocol
from pipelines.rig.solids import SOLIDS

FEW = Protocol(temperatures=(-40.0, -20.0, 0.0, 20.0, 40.0), frequencies=tuple(np.geomspace(10.0, 0.1, 9).tolist()))


def settings_for(name: str, *exports: str, **changes: Any) -> Dma:
    solid = SOLIDS[name]
    nu, T_ref = Quantity(solid.nu, 0.0, "1"), Quantity(solid.T_ref, 0.0, "degC")
    stated = Dma(kind="dma", rheometer=list(exports) or ["x.csv"], mode=solid.mode, nu=nu, T_ref=T_ref)
    return msgspec.structs.replace(stated, **changes)
