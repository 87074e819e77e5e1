"""The settings of a simulation for another device than site.yaml states."""

from runout.config.schema import SimulationSettings
from runout.errors import ConfigError


def on_device(stated: SimulationSettings, device: str) -> SimulationSettings:
    """The settings with another device: "cpu", "cuda:N", "cuda" or "auto" (GPUs if there are any, else the CPU).

    Raises
    ------
    DeviceError
        If there is no such device; the message lists the devices of the machine.
    ConfigError
        If sleep_speed is above 0, which GPUs do not support.
    """
    from runout.backends.protocol import find_device

    found = find_device(device)
    if stated.sleep_speed and device == "auto":
        found = device = "cpu"
    elif stated.sleep_speed and found != "cpu":
        named = f"simulation.sleep_speed {stated.sleep_speed}"
        raise ConfigError(f"{named} runs on the CPU, not on {found}; leave --device out, or set sleep_speed: 0.0")
    place = "cuda" if device == "cuda" or (device == "auto" and found != "cpu") else found
    backend = "hash" if place != "cpu" else "scan" if stated.backend == "hash" else stated.backend
    return stated.model_copy(update={"device": place, "backend": backend})
