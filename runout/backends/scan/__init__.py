"""The CPU backend: a sparse grid of 4 x 4 x 4 blocks found by marks and a prefix scan, compiled by numba.

``index`` finds the blocks, ``stencil`` holds the quadratic stencil in lanes, ``particles_to_grid`` moves mass and momentum to the
grid, ``schedule`` tells when a node has all that it needs and ``grid`` calls these kernels, ``ground``, ``contact_detection`` and
``contact_solution`` apply the terrain, ``grid_to_particles`` brings velocities back and follows law and position, ``sort`` keeps
the particles by block and cell, ``observe`` sums for observers, ``backend`` puts them in order. What only some scenes need lies
apart: ``zones`` of friction; ``forces``, ``gradients`` and ``gradient_transfer`` of transfers besides the packed one; ``sleep``
and ``rest`` of blocks at rest. ``precompile`` compiles, ``waiting`` tells threads how long to keep their cores.

Every sum is taken in an order that does not depend on the number of threads: a block adds its particles to an arena, and
each node gathers from the up to eight arenas that overlap it as soon as they are there; then other blocks take them.
"""
