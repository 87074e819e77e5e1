"""What the reader says of a site.yaml that it refuses."""

import pytest

from runout.config.read import load
from runout.errors import ConfigError, ExitCode


def problems(folder) -> list[str]:
    """Lines of the error that a site folder raises."""
    with pytest.raises(ConfigError) as caught:
        load(folder)
    assert caught.value.exit_code == ExitCode.CONFIGURATION
    return str(caught.value).splitlines()
