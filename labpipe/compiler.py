"""Numba's tables of types, filled when this module is loaded.

That takes a fifth of a second in each process that calls compiled code; those forked from one that
has loaded this module have it behind them.
"""

from numba.core.registry import cpu_target

cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
