"""Functions that are compiled only as parts of the kernels that call them.

By itself numba optimises each function together with all that it calls and turns it into machine
code, so that what lies deep below a kernel is worked on once for each level above it. The kernels of
a drop, 50 functions, took 10 s so and take 6 s when only what Python calls is finished; the machine
code of a kernel is the same.
"""

from collections.abc import Callable
from typing import Any

import numba.core.codegen
import numba.core.compiler

_Library: Any = numba.core.codegen.JITCodeLibrary
_Compiler: Any = numba.core.compiler.Compiler


class _Part(_Library):
    """Code that is neither optimised nor made executable before it is linked into a kernel."""

    @property
    def codegen(self) -> "_Part":
        """What stores the environment of an executable function: there is none here."""
        return self

    def set_env(self, *_: object) -> None:
        """Store no environment."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return the null pointer: Python cannot call this."""
        self._ensure_finalized()
        return 0


class LinkedOnly(_Compiler):
    """Numba's compiler, which leaves the code as it is for the kernel that calls it."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile a function for one signature."""
        self.state.library = _Part(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)
