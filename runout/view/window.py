"""A window on a scene with a slider for the time. Only the process that draws imports this module."""

import numpy as np

from runout.report.marks import INK
from runout.view.picture import Picture


class Player:
    """Frame that a window shows; the slider and the arrow keys change it.

    Parameters
    ----------
    picture : Picture
    """

    def __init__(self, picture: Picture):
        self.picture, self.frame = picture, 0

    def to_time(self, time: float) -> None:
        """Show the frame next to a time [s]."""
        self.show(int(np.argmin(np.abs(self.picture.scene.times - time))))

    def beside(self, by: int) -> int:
        """Number of an earlier or a later frame."""
        return int(np.clip(self.frame + by, 0, len(self.picture.scene.times) - 1))

    def show(self, frame: int) -> None:
        """Show a frame, unless it is shown."""
        if frame != self.frame:
            self.frame = frame
            self.picture.show(frame)


def open_window(picture: Picture) -> None:
    """Open a window; returns when the user closes it."""
    prepare(picture)
    picture.plotter.show(title="runout view")


def prepare(picture: Picture) -> Player:
    """Add the slider and the keys to a picture."""
    player, times = Player(picture), picture.scene.times
    if len(times) > 1:
        slider = picture.plotter.add_slider_widget(
            player.to_time, [float(times[0]), float(times[-1])], value=float(times[0]), title="time [s]", fmt="%.3g",
            pointa=(0.3, 0.08), pointb=(0.7, 0.08), color=INK, interaction_event="always", style="modern",
        )  # fmt: skip

        def move(by: int) -> None:
            slider.GetRepresentation().SetValue(float(times[player.beside(by)]))  # before it is drawn
            player.show(player.beside(by))

        picture.plotter.add_key_event("Right", lambda: move(1))
        picture.plotter.add_key_event("Left", lambda: move(-1))
    return player
