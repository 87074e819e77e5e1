"""Films of frames."""

import numpy as np
import pytest
from PIL import Image

from runout.errors import ConfigError, RenderError
from runout.view import film


@pytest.fixture
def frames(tmp_path):
    """Three frames of one colour each, with an odd height."""
    paths = []
    for k, colour in enumerate(((200, 30, 30), (30, 200, 30), (30, 30, 200))):
        paths.append(tmp_path / f"frame_{k:04d}.png")
        Image.fromarray(np.full((49, 64, 3), colour, np.uint8)).save(paths[-1])
    return paths


def test_a_gif_has_every_frame_and_its_colours(frames, tmp_path):
    path = film.write_film(frames, [0, 1, 2], tmp_path / "out" / "a.gif", 5.0)
    with Image.open(path) as made:
        assert (made.n_frames, made.info["duration"], made.size) == (3, 200, (64, 48))
        for k, colour in enumerate(((200, 30, 30), (30, 200, 30), (30, 30, 200))):
            made.seek(k)
            assert np.abs(np.array(made.convert("RGB"))[20, 20].astype(int) - colour).max() <= 4


def test_an_mp4_has_every_frame_and_its_size(frames, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra view)")
    path = film.write_film(frames, [0, 1, 2], tmp_path / "a.mp4", 5.0)
    assert imageio_ffmpeg.count_frames_and_secs(str(path))[0] == 3
    reader = imageio_ffmpeg.read_frames(str(path))
    assert next(reader)["size"] == (64, 48)
    first = np.frombuffer(next(reader), np.uint8).reshape(48, 64, 3)
    assert np.abs(first[20, 20].astype(int) - (200, 30, 30)).max() <= 12


def test_a_folder_has_the_frames_with_their_times_and_no_older_ones(frames, tmp_path):
    folder = tmp_path / "out"
    film.write_film(frames, [0.0, 1.5, 3.0], folder, 5.0)
    (folder / "notes.txt").write_text("mine")
    film.write_film(frames[:2], [0.0, 3.0], folder, 5.0)
    assert sorted(path.name for path in folder.iterdir()) == ["frame_0000.png", "frame_0001.png", "notes.txt", "times.csv"]
    assert (folder / "times.csv").read_text() == "file,time_s\nframe_0000.png,0\nframe_0001.png,3\n"


def test_without_a_codec_one_line_says_what_works(frames, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "find_spec", lambda name: None)
    with pytest.raises(RenderError, match=r"pip install 'runout\[view\]'.*GIF"):
        film.write_film(frames, [0, 1, 2], tmp_path / "a.mp4", 5.0)
    assert film.write_film(frames, [0, 1, 2], tmp_path / "a.gif", 5.0).is_file()


def test_a_name_of_no_film_is_refused(frames, tmp_path):
    with pytest.raises(ConfigError, match=r"\.mp4 or \.gif"):
        film.write_film(frames, [0, 1, 2], tmp_path / "a.avi", 5.0)
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="is a file; name a folder"):
        film.write_film(frames, [0, 1, 2], tmp_path / "file", 5.0)
