"""Sampling error of the run-out of an ensemble, from the spread between its members and their number."""

import math

from runout.model.limits import SMALLEST_NET

BAR = 1.645  # standard deviations of a bar that holds 9 of 10 cases of a normal error
OF_MEDIAN = math.sqrt(math.pi / 2.0)  # standard error of a median over that of a mean, for normal values
OF_NET = 1.0 / 1.6  # error of a Sobol net over that of independent members: 1/1.6 to 1/2.5, docs/guide/maps.md; the larger counts


def median_error(spread: float, members: int, *, net: bool = True) -> float:
    """Error bar of the median of a quantity over members, in the unit of ``spread``; it is meant to hold 9 of 10 cases.

    The standard error of a median of independent members is 1 / (2 f sqrt(n)), where f is the probability density at the
    median; for normal values of standard deviation s it is sqrt(pi / 2) s / sqrt(n). A Sobol net of
    :data:`~runout.model.limits.SMALLEST_NET` members or more has :data:`OF_NET` times that.

    Parameters
    ----------
    spread : float
        Standard deviation s between the members.
    members : int
        Their number n.
    net : bool
        Whether they are a Sobol net.
    """
    share = OF_NET if net and members >= SMALLEST_NET else 1.0
    return BAR * share * OF_MEDIAN * spread / math.sqrt(members)
