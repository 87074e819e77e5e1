"""The GPU backend: a sparse grid of 4 x 4 x 4 blocks found by an open-addressing table of keys, compiled by warp.

``index`` finds the blocks, ``cells`` lists the particles of each cell, ``particles_to_grid`` brings mass and momentum to the nodes,
``contact_detection`` tells what touches the ground, which ``ground`` cuts into tiles, ``contact_solution`` pushes that off it,
``grid_to_particles`` takes velocities back to the particles and holds the order of the law, ``observe`` and ``readback`` sum up
what is seen. ``sort`` makes the index anew and brings the particles into its order; ``batch`` puts all in order for any number of
scenes, ``backend`` for one. ``kernels`` compiles them, ``natives`` and ``reductions`` hold what is said in the language of the
card. The same kernels run on the CPU, one lane a block, which is how they are tested without a GPU.

A thread owns a cell, keeps the sums of its 27 nodes in registers and adds them to a tile that the block shares, in turns in
which no two cells meet at a node. Steps and sorts are captured as CUDA ``graphs``: every kernel reads counts, the time step, and
whether to go on, from the device, and the host reads the ``device_status`` once a stretch of steps.
"""
