"""The GPU backend: a sparse grid of 4 x 4 x 4 blocks in a hash table, compiled by warp.

``groups`` lists all arrays. Phases: ``index`` finds blocks, ``cells`` lists the particles of each cell, ``particles_to_grid``,
``contact_detection`` (with ``ground``), ``contact_solution``, ``stencil`` (nodes), ``substeps``, ``grid_to_particles`` (with
``deform``), ``sort``, ``observe``, ``columns`` (with ``spreading``) and ``readback``. ``step`` is the order of the launches,
``parts`` what a batch holds, ``batch`` the steps of several scenes, ``backend`` of one. ``kernels`` compiles; ``natives`` and
``reductions`` are in CUDA.
The same kernels run on a CPU, one lane a block, for tests without a GPU.

Steps, sorts, looks and rows of the ledger are recorded as CUDA ``graphs``: kernels read counts, time steps and flags on the
device. The host reads the ``device_status`` once per series of steps.
"""
