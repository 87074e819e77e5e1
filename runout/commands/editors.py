"""Commands that write what other programs need: the plugin of QGIS, and the schema of site.yaml for editors."""

import logging

from runout.commands.options import Injected, command
from runout.errors import ConfigError, ExitCode
from runout.io.atomic import write_text
from runout.io.places import require_place

LOGGER = logging.getLogger(__name__)


@command(writes=False)
def schema(*, session: Injected) -> int:
    """Print the JSON schema of site.yaml for editors, or write it to the file of --out; `runout new` writes it beside site.yaml."""
    from runout.config.json_schema import schema_text

    if session.out is None:
        print(schema_text(), end="")
        return ExitCode.OK
    require_place("--out", session.out, folder=False)
    LOGGER.info("wrote %s", write_text(schema_text(), session.out))
    return ExitCode.OK


@command(writes=False)
def qgis_plugin(*, session: Injected) -> int:
    """Write the plugin of QGIS, runout_qgis_VERSION.zip or the file of --out; in QGIS: Plugins, Install from ZIP."""
    from runout.workflow.qgis_plugin import write_plugin

    if session.out is not None:
        if session.out.suffix.lower() != ".zip":
            raise ConfigError(f"--out {session.out}: its name must end in .zip")
        require_place("--out", session.out, folder=False)
    LOGGER.info("wrote %s; in QGIS: Plugins > Manage and Install Plugins > Install from ZIP", write_plugin(session.out))
    return ExitCode.OK
