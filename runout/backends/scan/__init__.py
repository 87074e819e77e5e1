"""The CPU backend: a sparse grid of 4 x 4 x 4 blocks, found by marks and a prefix scan, and kernels compiled by numba.

The phases of a step, one module each, have the same names in the backend ``hash``: ``index``, ``particles_to_grid``,
``contact_detection``, ``contact_solution``, ``grid``, ``grid_to_particles``, ``sort``, ``observe``, ``state``. Each head comment
draws the arrays of its phase. ``substep`` is a phase of transfers of several substeps.

    backend       calls the phases              groups       arrays that kernels take together
    workspace     arrays by block               schedule     which thread sums which nodes, and when
    constants     of run and time step          totals       sums over the run
    kernels       compiled functions            precompile   compiles them in a separate process
    workers       threads and buffers           waiting      how long threads wait
    stencil       weights and rows of nodes     ground       coefficients of the surface by block
    domain        edge of the scene             raster_sums  maps for observers
    checkpoint    state as plain arrays         forecast     memory before a run
    tile          32 particles as columns       slots        where blocks keep their particles
    warm_up       small scenes for precompile   shared_parts work that processes share
    deferred_code machine code of kernels only

For some scenes only: ``zones`` (friction zones).

Each sum has an order that does not depend on the number of threads: a block adds its particles to an arena, and each node adds
the up to eight arenas that overlap it.
"""
