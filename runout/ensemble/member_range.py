"""A range of members, stated as text: the part of an ensemble that one job of a job array computes."""

import re

from runout.errors import ConfigError


def member_range(text: str, members: int) -> range:
    """Members of a range ``first:end``, the end excluded; ``first:``, ``:end`` and a single number are ranges as well.

    Raises
    ------
    ConfigError
        If it is no range, holds no member, or reaches beyond the ``members`` of the ensemble.
    """
    stated = re.fullmatch(r"(\d{0,9})(:?)(\d{0,9})", text.strip(), re.ASCII)
    if not stated or not any(stated.group(1, 3)):
        raise ConfigError(f"--members {text[:80]}: this is no range; state first:end, such as 0:100 for the members 0 to 99")
    first = int(stated[1] or 0)
    end = int(stated[3] or members) if stated[2] else first + 1
    if not first < end <= members:
        why = "it holds no member" if first >= end and first < members else f"the ensemble has members 0 to {members - 1}"
        fix = f"; use {first}:{members}" if first < members < end else ""
        raise ConfigError(f"--members {text}: {why}{fix}")
    return range(first, end)
