"""The kernels build for an H100 without one at hand, within the registers that their speed was measured with."""

import ctypes
import struct
from pathlib import Path

import pytest
import warp as wp

from runout.backends.hash.kernels import compiled_kernels
from runout.model.friction_laws import FRICTIONS
from runout.model.law_mixtures import friction_law, material_law
from runout.model.laws import LAWS

ARCHITECTURE = 90
COULOMB = FRICTIONS.find("coulomb")
REGISTERS, FRAME = 0x2F, 0x11  # attributes of the section .nv.info of a cubin
LARGEST = {  # registers a thread of the kernels that take the time; the others need at most 112
    "float32": {"particles_to_grid": 168, "grid_to_particles": 128, "sum_blocks": 128, "cut_tiles": 128},
    "float64": {"particles_to_grid": 255, "grid_to_particles": 222, "find_contacts": 168, "solve_contacts": 168, "sum_blocks": 136}
    | {"cut_tiles": 128},
}
STRUCTURES: dict[str, dict[str, int]] = {  # of contact with structures; bounded for single precision, not measured
    "float32": {"find_structure_contacts": 128},
    "float64": dict.fromkeys(("find_structure_contacts", "solve_contacts"), 168),
}
SUBSTEPS: dict[str, dict[str, int]] = {  # of further substeps of a transfer; at 96, with more spilled, 15 % slower
    "float32": {"strain_in_place": 128, "grid_to_particles": 128},
    "float64": {"strain_in_place": 255, "grid_to_particles": 255, "solve_contacts": 168},
}
SUBSTEPS_SPILLED = {
    "float32": {"strain_in_place": 88},
    "float64": {"strain_in_place": 64},
}
AREAS_SPILLED = {"find_contacts": 8, "solve_contacts": 8}  # of laws of friction that use ground areas, in single precision
SEVERAL_SPILLED = {"find_contacts": 8, "solve_contacts": 56}  # of Coulomb and Voellmy in one run, in single precision
STRUCTURES_SPILLED = {"float32": {"solve_contacts": 8}, "float64": {}}
SPILLED: dict[str, dict[str, int]] = {"float32": {"find_contacts": 8}, "float64": {"particles_to_grid": 272}}  # bytes a thread


def resources(cubin: Path) -> dict[str, dict[int, int]]:
    """Attributes of every kernel of an ELF file of machine code for a GPU."""
    elf = cubin.read_bytes()
    offset, (size, number, names_at) = struct.unpack_from("<Q", elf, 0x28)[0], struct.unpack_from("<HHH", elf, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", elf, offset + i * size) for i in range(number)]

    def text(table, start):
        begin = sections[table][4] + start
        return elf[begin : elf.index(b"\0", begin)].decode()

    symbols = next(s for s in sections if s[1] == 2)
    info = next(s for s in sections if text(names_at, s[0]) == ".nv.info")
    found: dict[str, dict[int, int]] = {}
    place, end = info[4], info[4] + info[5]
    while place < end:
        kind, attribute, length = struct.unpack_from("<BBH", elf, place)
        if kind == 4 and length == 8:
            symbol, value = struct.unpack_from("<II", elf, place + 4)
            name = text(symbols[6], struct.unpack_from("<I", elf, symbols[4] + 24 * symbol)[0])
            found.setdefault(name, {})[attribute] = value
        place += 4 + (length if kind == 4 else 0)
    return {name: values for name, values in found.items() if "_cuda_kernel_forward" in name}


def machine_code(module, suffix="cubin"):
    """Files of a module built for the architecture; warp's cache keeps them under the hash of all that they depend on."""
    wp.init()
    folder = Path(wp.config.kernel_cache_dir) / f"built_for_sm_{ARCHITECTURE}" / module.get_module_hash().hex()
    choices = {"device": None, "arch": ARCHITECTURE, "module_dir": folder, "use_ptx": suffix == "ptx"}
    return [*folder.glob(f"*.{suffix}")] or wp.compile_aot_module(module, **choices)


def require_within(kernels, modules, registers, spilled):
    """Kernels of modules, built for the architecture, need no more than tables say; returns how many they are."""
    built: dict[str, dict[int, int]] = {}
    for module in modules:
        for path in machine_code(module):
            built |= resources(path)
    here = set(modules)
    wanted = [value.key for value in vars(kernels).values() if isinstance(value, wp.Kernel) and value.module in here]
    for name in wanted:
        values = next(v for mangled, v in built.items() if mangled.split("_cuda")[0][:-9] == name)  # name_12345678_cuda...
        assert values[REGISTERS] <= registers.get(name, 112), name
        assert values[FRAME] <= spilled.get(name, 0), name
    return len(wanted)


@pytest.mark.parametrize("structured", [False, True])
def test_kernels_take_at_most_twelve_arguments_of_little_more_than_a_kilobyte_in_all(structured):
    """A group is one argument, and packed: with 2.7 kilobytes a launch takes a microsecond more."""
    more = structured, structured  # the last: substeps
    of_run = compiled_kernels(LAWS.find("drucker_prager"), COULOMB, "float64", False, False, *more)
    kernels = vars(of_run) | (vars(of_run.later) if structured else {})
    arguments = {name: k.adj.args for name, k in kernels.items() if isinstance(k, wp.Kernel)}
    groups, array = vars(kernels["groups"]).values(), ctypes.sizeof(wp.empty(0, dtype=wp.int32, device="cpu").__ctype__())
    sizes = {group: ctypes.sizeof(group.ctype) for group in groups}
    number = ctypes.sizeof(ctypes.c_double)
    bytes_of = {
        name: sum(sizes.get(a.type, array if isinstance(a.type, wp.array) else number) for a in some)
        for name, some in arguments.items()
    }
    assert max(map(len, arguments.values())) <= 12
    assert 1000 < max(bytes_of.values()) <= 1250


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_kernels_build_for_sm_90_within_their_registers_and_do_not_spill(precision):
    kernels = compiled_kernels(LAWS.find("drucker_prager"), COULOMB, precision, False)
    assert require_within(kernels, kernels.modules, LARGEST[precision], SPILLED[precision]) > 20


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_kernels_of_further_substeps_build_beside_those_of_the_first(precision):
    """Those of a transfer of one substep stay as they are."""
    law = LAWS.find("drucker_prager")
    plain, substepped = (compiled_kernels(law, COULOMB, precision, False, substepped=several) for several in (False, True))
    assert not {name for name, kernel in vars(plain).items() if name != "modules" and vars(substepped)[name] is not kernel}
    more = [module for module in substepped.modules if module not in plain.modules]
    found = require_within(substepped.later, more, SUBSTEPS[precision], SUBSTEPS_SPILLED[precision])
    assert found == len(("strain_in_place", "grid_to_particles", "solve_contacts", "end_substep"))


@pytest.mark.parametrize(("precision", "ordered"), [("float32", True), ("float64", False)])
def test_kernels_of_structures_build_beside_the_others_which_stay_as_they_are(precision, ordered):
    """They are the same for all laws of material and friction."""
    plain, structured, other = (
        compiled_kernels(LAWS.find(law), COULOMB, precision, ordered, structured=structured)
        for law, structured in (("drucker_prager", False), ("drucker_prager", True), ("granular_flow", True))
    )
    more = [module for module in structured.modules if module not in plain.modules]
    assert set(plain.modules) < set(structured.modules)
    assert set(more) <= set(other.modules)
    assert require_within(structured, more, STRUCTURES[precision], STRUCTURES_SPILLED[precision]) == 5


@pytest.mark.parametrize("law", ["voellmy_base", "voellmy"])
def test_contact_with_ground_areas_builds_within_the_same_registers_and_hardly_spills(law):
    kernels = compiled_kernels(LAWS.find("drucker_prager"), FRICTIONS.find(law), "float32", False)
    contact = {kernels.find_contacts.module, kernels.solve_contacts.module, kernels.update_nodes.module}
    assert require_within(kernels, contact, LARGEST["float32"], AREAS_SPILLED) >= 4


def test_kernels_of_several_laws_build_within_the_registers_of_one():
    """Contact spills more: the resistances of both laws are in one kernel."""
    law = material_law(map(LAWS.find, ("drucker_prager", "herschel_bulkley")))
    friction = friction_law(map(FRICTIONS.find, ("coulomb", "voellmy")))
    kernels = compiled_kernels(law, friction, "float32", False)
    of_laws = [module for module in kernels.modules if law.name in module.name or friction.name in module.name]
    assert require_within(kernels, of_laws, LARGEST["float32"], SEVERAL_SPILLED) >= 7


def test_deterministic_kernels_those_of_friction_zones_and_of_another_law_build_too():
    """All in one build: none of the three takes code away that the others need. Tests above build the sets that do not differ."""
    plain = compiled_kernels(LAWS.find("drucker_prager"), COULOMB, "float32", False, substepped=True)
    kernels = compiled_kernels(LAWS.find("granular_flow"), COULOMB, "float32", True, zoned=True, substepped=True)
    differing = [module for module in kernels.modules if module not in plain.modules]
    assert {name.split(".")[2] for name in (module.name for module in differing)} >= {"sums", "law", "friction", "substeps"}
    for module in differing:
        assert all(".version" in path.read_text()[:2000] for path in machine_code(module, "ptx"))


def test_another_law_compiles_only_what_names_it():
    """Names of the kernels that differ, for laws of the material and of friction, zones and sums in fixed order."""
    plain = vars(compiled_kernels(LAWS.find("elastic"), COULOMB, "float32", False))

    def differing(law, friction, ordered=False, zoned=False):
        other = vars(compiled_kernels(LAWS.find(law), FRICTIONS.find(friction), "float32", ordered, zoned))
        return {name for name, kernel in plain.items() if isinstance(kernel, wp.Kernel) and other[name] is not kernel}

    of_law = {"grid_to_particles", "change_step", "unpack", "sum_blocks", "sum_gone"}
    of_friction, of_sums = {"solve_contacts", "update_nodes"}, {"particles_to_grid", "find_contacts", "list_cells", "note_up"}
    assert differing("drucker_prager", "coulomb") == of_law
    assert differing("elastic", "velocity_weakening") == of_friction
    assert differing("elastic", "coulomb", zoned=True) == of_friction
    assert differing("elastic", "voellmy") == of_friction | of_sums | {"sum_columns"}
    assert differing("drucker_prager", "voellmy", ordered=True) == of_law | of_friction | of_sums | {"sum_columns"}
