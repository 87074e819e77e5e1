"""Scripts of the gallery: each runs, makes a picture, and is short. Their own assertions are on physics."""

from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
LONGEST = 40  # lines


def test_the_gallery_has_a_script_for_each_of_its_pictures():
    assert len(SCRIPTS) >= 12


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_of_the_gallery_runs_and_makes_one_picture(script, monkeypatch, tmp_path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    monkeypatch.chdir(tmp_path)
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    pyplot.close("all")
    try:
        exec(compile(text, str(script), "exec"), {"__name__": "__main__"})
        figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
        assert len(figures) == 1
        titles = [axes.get_title() for axes in figures[0].axes]
        assert any(titles), "a picture says what it shows"
        assert not any("crs" in title for title in titles)
        for axes in figures[0].axes:
            assert axes.get_xlabel() or axes.get_ylabel(), f"{axes.get_title()}: no axis has a name"
    finally:
        pyplot.close("all")
    assert list(tmp_path.iterdir()) == [], "a script leaves no files"
