"""Makes machine code only of functions that are called, in processes that compile kernels for the cache.

Numba makes machine code of every function that it compiles, also of those that all callers inline: of some 430 in the kernels of a
law, 60 are called. Here a function gets machine code when its address is first asked for. The cache holds the same code.
"""

import logging
from typing import Any

LOGGER = logging.getLogger(__name__)
WANTED = {
    "JITCodeLibrary": ("_finalize_final_module", "get_pointer_to_function", "_ensure_finalized", "_unserialize"),
    "JITCPUCodegen": ("set_env",),
}


def make_code_when_called() -> bool:
    """Make machine code of a function when its address is first asked for.

    Returns whether this is so. It replaces private methods of numba; a numba that lacks them stays as it is.
    """
    from numba.core import codegen

    if not all(hasattr(getattr(codegen, owner, None), name) for owner, names in WANTED.items() for name in names):
        LOGGER.debug("this numba makes machine code of every function; compilation takes a fifth longer")
        return False
    library: Any = codegen.JITCodeLibrary
    engine: Any = codegen.JITCPUCodegen
    if getattr(library, "puts_off", False):
        return True
    make, address, set_environment = library._finalize_final_module, library.get_pointer_to_function, engine.set_env

    def put_off(self: Any) -> None:
        if _comes_from_cache(self):
            make(self)
        else:
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

    library._finalize_final_module, library.get_pointer_to_function, library.puts_off = put_off, address_of, True
    engine.set_env = set_if_made
    return True


def _comes_from_cache(library: Any) -> bool:
    """Whether the machine code is there already."""
    return bool(getattr(library, "_object_caching_enabled", False)) and getattr(library, "_compiled_object", None) is not None


def _defines(module: Any, name: str) -> bool:
    """Whether a module has the code of a function."""
    try:
        return not module.get_function(name).is_declaration
    except NameError:
        return False
