"""Directive that prints the tables of a file that `runout bench --json` wrote: ``{bench} RECORD.json``."""

import json
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from runout.studies.work_precision import cost_table, table


class BenchTables(SphinxDirective):
    """Machine, stages and ratios of one run of the benchmark."""

    required_arguments = 1

    def run(self) -> list[Any]:
        """Nodes of the tables."""
        relative, path = self.env.relfn2path(self.arguments[0])
        self.env.note_dependency(relative)
        content = json.loads(Path(path).read_text())
        machine, versions = content["machine"], content["versions"]
        text = "\n\n".join(
            [
                f"{machine['cores']} cores, vectors of {machine['vector_bits']} bits, {machine['architecture']}; "
                f"numba {versions['numba']}, llvmlite {versions['llvmlite']}, NumPy {versions['numpy']}; "
                f"commit {versions['commit']}.",
                "Shares of the time of a step, and memory:",
                cost_table(content),
                "Ratios:",
                table(content),
            ]
        )
        nodes: list[Any] = self.parse_text_to_nodes(text)
        return nodes


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("bench", BenchTables)
    return {"parallel_read_safe": True}
