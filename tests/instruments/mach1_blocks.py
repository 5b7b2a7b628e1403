"""The blocks of a Mach-1 file, one by one."""

import json

import numpy as np
import xarray as xr


def split_blocks(dataset: xr.Dataset) -> list[xr.Dataset]:
    """Return one Dataset per block, over its own ``time``."""
    stops, blocks = np.cumsum([0, *dataset["n_rows"].values]).astype(int), []
    for index, block in enumerate(json.loads(dataset.attrs["blocks"])):
        part = dataset.isel(block_index=index, sample=slice(stops[index], stops[index + 1]))
        part = part.drop_vars("block").swap_dims(sample="time")
        part.attrs = {
            "block": json.dumps(block),
            "start": block["start"],
            "compression_sign": block["compression_sign"],
        }
        blocks.append(part)
    return blocks
