"""Mass that enters at a line: the push of the flow upstream, which is not there."""

import math
from typing import Any

from runout.physics.tensors import real


def push_of_flow(u: Any, g: Any, H: Any, k: Any):
    """Speed [m/s] that mass gains when it enters, so that it brings the momentum flux q u + k g H^2/2 of a steady flow.

    ``u`` is the speed [m/s] and ``H`` the thickness [m] of the flow, ``g`` the gravity [m/s2] normal to the ground, ``k`` the
    lateral over the normal stress [1]. Slower than half the speed of long waves, the push is that of this speed.
    """
    least = real(0.5) * math.sqrt(max(real(0.0), g * H))
    return k * g * H / (real(2.0) * max(u, max(least, real(1e-9))))
