"""The settings of a simulation with what the command line states instead of site.yaml: device, cell size."""

from collections.abc import Sequence

from runout.config.schema import SimulationSettings
from runout.model.limits import spacing_of


def on_device(settings: SimulationSettings, device: str) -> SimulationSettings:
    """The settings with another device: "cpu", "cuda:N", "cuda" or "auto" (GPUs if there are any, else the CPU).

    Raises DeviceError if there is no such device; the message lists the devices of the machine.
    """
    from runout.backends.protocol import find_device

    first_device = find_device(device)
    place = "cuda" if device == "cuda" or (device == "auto" and first_device != "cpu") else first_device
    backend = "hash" if place != "cpu" else "scan" if settings.backend == "hash" else settings.backend
    return settings.model_copy(update={"device": place, "backend": backend})


def with_cell_size(settings: SimulationSettings, cell_size: Sequence[float]) -> SimulationSettings:
    """The settings with another grid spacing [m], one number or three; cfl stays as it is.

    Raises ConfigError if the spacing is out of range.
    """
    east, north, up = spacing_of(tuple(cell_size))  # type: ignore[arg-type]
    return settings.model_copy(update={"cell_size": east if len(cell_size) == 1 else [east, north, up]})
