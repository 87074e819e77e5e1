"""The time of a window."""

from types import SimpleNamespace

import pytest

pytest.importorskip("pyvista", reason="pyvista is not installed (extra view)")


def test_the_slider_and_the_keys_choose_the_frame(scene):
    from runout.view.renderer import Player

    shown = []
    player = Player(SimpleNamespace(scene=scene, show=shown.append))
    for time in (0.2, 2.0, 2.6, 6.9):
        player.to_time(time)
    assert shown == [1, 2]  # frames at 0, 2.5 and 7 s; none is drawn twice
    assert (player.beside(1), player.beside(-1), player.beside(-9)) == (2, 1, 0)
