"""The blocks of a Mach-1 file, one by one."""

import json

import numpy as np
import xarray as xr


def split_blocks(dataset: xr.Dataset) -> list[xr.Dataset]:
    """Return one Dataset per block, over its own ``time``, with only the variables that it has."""
    described = json.loads(dataset.attrs["blocks"])
    starts = np.concatenate([[0], np.cumsum(dataset["n_rows"].values)]).astype(int)
    blocks = []
    for index, block in enumerate(described):
        part = dataset.isel(block_index=index, sample=slice(starts[index], starts[index + 1]))
        present = {column["variable"] for column in block["columns"]}
        absent = [
            name for name, variable in part.data_vars.items() if "sample" in variable.dims and name not in present
        ]
        part = part.drop_vars([*absent, "block"]).swap_dims(sample="time")
        kept = {k: v for k, v in dataset.attrs.items() if k not in ("blocks", "header", "work")}
        part.attrs = kept | {
            "block": json.dumps(block, ensure_ascii=False),
            "block_number": index,
            "function": block["function"],
            "start": block["start"],
            "incomplete": int(block["incomplete"]),
            "compression_sign": block["compression_sign"],
        }
        blocks.append(part)
    return blocks
