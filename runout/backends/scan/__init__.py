"""The CPU backend: a sparse grid of 4 x 4 x 4 blocks found by marks and a prefix scan, compiled by numba.

``index`` finds the blocks, ``transfer`` moves mass and momentum between particles and grid, ``grid`` updates nodes and
applies contact, ``particles`` holds the law, the motion and the sort, ``backend`` puts them in order.

Every sum is taken in an order that does not depend on the number of threads: a block adds its particles to an arena of
its own, and each node then gathers from the up to eight arenas that overlap it.
"""
