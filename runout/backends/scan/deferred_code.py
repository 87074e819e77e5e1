"""Spares machine code that is never called, in processes that compile kernels for the cache.

Numba makes machine code of every function, also of those that their callers inline: of some 420 in the kernels of a law, 60 are
called. What the cache holds does not change.
"""

from typing import Any


def make_code_when_called() -> None:
    """Make machine code of a function when its address is first asked for; a numba of another structure stays as it is."""
    from numba.core import codegen

    library: Any = codegen.JITCodeLibrary
    engine: Any = codegen.JITCPUCodegen
    if not hasattr(library, "_finalize_final_module") or not hasattr(engine, "set_env"):
        return
    make, address, set_environment = library._finalize_final_module, library.get_pointer_to_function, engine.set_env

    def put_off(self: Any) -> None:
        self._finalized = self.is_put_off = True

    def address_of(self: Any, name: str) -> int:
        self._ensure_finalized()
        if getattr(self, "is_put_off", False):
            if not _defines(self._final_module, name):
                return 0  # the answer of numba
            self.is_put_off = False
            make(self)
        return int(address(self, name))

    def set_if_made(self: Any, name: str, environment: Any) -> None:
        if self._engine.get_global_value_address(name):
            set_environment(self, name, environment)

    library._finalize_final_module, library.get_pointer_to_function = put_off, address_of
    engine.set_env = set_if_made


def _defines(module: Any, name: str) -> bool:
    """Whether a module has the code of a function."""
    try:
        return not module.get_function(name).is_declaration
    except NameError:
        return False
