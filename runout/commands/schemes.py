"""Command that lists the schemes of danger classes."""

from typing import Annotated

from cyclopts import Parameter

from runout.commands.options import Injected, command
from runout.errors import ConfigError, ExitCode


@command(writes=False)
def schemes(
    name: Annotated[str | None, Parameter(help="Print this scheme, to read it or to copy it to a file of your own.")] = None,
    *,
    session: Injected,
) -> int:
    """List the schemes of danger classes for `hazard.scheme`, or print one."""
    from runout.config.scheme import names, path_of, read_scheme, unknown

    if name is None:
        for one in names():
            scheme = read_scheme(one)
            print(f"{one:28} {scheme.title}; {scheme.process}; checked: {', '.join(scheme.states)}")
    elif name in names():
        print(path_of(name).read_text(encoding="utf-8"), end="")
    else:
        raise ConfigError("; ".join(unknown(name)))
    return ExitCode.OK
