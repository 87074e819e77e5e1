"""A small scene: a ramp that falls to the east, with a heap that slides down."""

import numpy as np

from runout.view.scene import FlowScene

CELL = 10.0


def ramp_scene(rows=24, columns=40):
    easting, northing = 500_000.0 + CELL * np.arange(columns), 5_000_000.0 - CELL * np.arange(rows)
    ground = np.broadcast_to(np.maximum(0.0, (200.0 - CELL * np.arange(columns)) * np.tan(np.radians(30))), (rows, columns)).copy()
    thickness = np.zeros((3, rows, columns), np.float32)
    for frame, column in enumerate((4, 14, 26)):
        thickness[frame, 9:15, column : column + 6] = 5.0
    speed = np.where(thickness > 0, np.array([0.0, 20.0, 5.0])[:, None, None], 0.0).astype(np.float32)
    outline = np.array([[4, 9], [10, 9], [10, 15], [4, 15], [4, 9]], float) * (CELL, -CELL) + (easting[0], northing[0])
    return FlowScene(easting, northing, ground, np.array([0.0, 2.5, 7.0]), thickness, speed, "ramp", outlines=[outline])
