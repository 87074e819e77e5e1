"""What a batch holds on its device; helpers receive it in one piece."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from types import SimpleNamespace

from runout.backends.hash.columns import ColumnSums
from runout.backends.hash.device_status import DeviceStatus
from runout.backends.hash.graphs import Graphs
from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.ground import Ground
from runout.backends.hash.host_buffers import HostBuffers
from runout.backends.hash.index import Index
from runout.backends.hash.layout import bytes_of
from runout.backends.hash.scenes import SceneArrays
from runout.backends.hash.state import Store
from runout.backends.hash.structures import Structures


@dataclass
class Parts:
    """Parts of a batch. Each owns its arrays and the groups of them that kernels take (see :mod:`runout.backends.hash.groups`)."""

    k: SimpleNamespace  # kernels
    ordered: bool  # sums in fixed order
    scenes: SceneArrays
    status: DeviceStatus
    ground: Ground | None
    store: Store
    index: Index
    structures: Structures | None
    columns: ColumnSums
    graphs: Graphs  # of steps, sorts, looks and rows of the ledger, for either place of the rows of particles
    buffers: HostBuffers = field(default_factory=HostBuffers)
    nodes: NodeArrays = field(init=False)

    @property
    def uses_area(self) -> bool:
        """Whether the law of friction uses the ground area of a contact."""
        return self.scenes.scenes[0].basal.law.uses_area

    @property
    def drags_column(self) -> bool:
        """Whether drag slows whole columns of nodes."""
        return self.scenes.scenes[0].basal.law.drags_column

    def make_nodes(self) -> None:
        """New arrays by block for the present index."""
        dragged = self.drags_column * self.scenes.mixed
        choices = self.uses_area, self.structures is not None, dragged, self.scenes.substepped
        self.nodes = NodeArrays(self.index, self.store, self.scenes.number, *choices)
        self.nodes.make_layers(self.index, self.store, self.scenes)
        if self.structures:
            self.structures.make_nodes(self.index, self.store, self.nodes)

    @property
    def generation(self) -> tuple[int, int, int]:
        """Counts how often arrays by block were made anew."""
        return self.index.generation, self.nodes.generation, self.structures.generation if self.structures else 0

    def launch(self, name: Hashable, enqueue: Callable[[], None], before: int) -> None:
        """Launches, on a GPU as a graph once they have come ``before`` times."""
        self.graphs.launch(name, self.generation, enqueue, before)

    def bytes_used(self) -> int:
        """Memory of the arrays that grow with particles, blocks, surfaces and structures [byte]."""
        names = "store", "index", "nodes", "ground", "structures"
        return bytes_of(*(part for part in map(vars(self).get, names) if part is not None))
