"""What is published of the sparse framework with a scan on the CPU and a hash on the GPU, and what cannot be compared with it.

Zhao, Blatny, Feng, Juel, Jiang & Gaume 2026, arXiv:2605.28525. Only these figures are used; its scenes and tables were not at hand.
"""

SOURCE = "Zhao, Blatny, Feng, Juel, Jiang & Gaume 2026, arXiv:2605.28525"
SPARSITIES = (2.9, 5.5, 373.0)  # nodes of the bounding box over active nodes [1]
SPEED_UP = {"CPU": 97.0, "GPU": 11.5}  # sparse over dense, the largest of each
MEMORY = 4.1 * 2**30  # [byte] of 10.7 M particles
PARTICLES = {10.0: 86e3, 8.0: 167e3, 6.0: 397e3, 4.0: 1.34e6, 2.0: 10.7e6}  # of the site by cell size [m]
SECONDS = {4.0: 182.0}  # of the site by cell size [m], on an RTX 5070 Ti
SLOPES = (14.0, 20.0, 25.0, 30.0)  # [deg] of the sliding box, with friction of 15 degrees
FRICTION_ANGLES = (20.0, 30.0, 40.0)  # [deg] of the collapsing columns
CODE_ON_ONE_CARD = (  # particles, then 1e9 particle-steps/s: published code in float64, runout in float64 and in float32
    (0.42e6, 0.161, 1.23, 2.50),
    (1.29e6, 0.185, 1.46, 3.43),
    (10.2e6, 0.212, 1.34, 5.25),
)
CODE_RUN = (
    "one H100 80GB, by an earlier runout with one substep: a Drucker-Prager layer on a plane, cells of 0.43 m, "
    "eight particles a cell"
)
NOT_COMPARABLE = (
    (
        "the two codes on one card",
        "same scene, card and sizes, but each with its own time step, contact and index; the published code "
        "computes in double precision only, so that its ratio to ours in float32 mixes number type and method",
    ),
    ("times", "another card and another processor; what the published times include is not known here"),
    ("dense over sparse", "depends on the dense control: ours has the same kernels over all blocks of the box, on both devices"),
    ("sparsity", "the published ratios of times are taken to be those of the largest sparsity"),
    ("site", "our terrain and release are synthetic, with the same drop, path, volume and cells; material and end time are ours"),
    ("number of particles", "eight of a cell in 9.3 Mm³ are 9.3 M with cells of 2 m; the published 10.7 M imply 10.7 Mm³"),
    ("memory", "the published code computes in double precision, ours here in single"),
    ("sliding box and columns", "no published numbers were at hand; ours stand beside closed forms and the laws of experiments"),
)
