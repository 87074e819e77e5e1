"""A site.yaml from elsewhere is refused at once, with one message: bombs, huge numbers, tags, merges, patterns, pipes."""

import os

import pytest
from refused_site import problems

from runout.config.document import SHOWN, dotted, shortened
from runout.config.read import load, site_file
from runout.config.site import read_site
from runout.errors import ConfigError, InputError
from runout.workflow.check import inspect

LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(8)
)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("title: A tilted plane\n", LAUGHS, "site.yaml:6: more than 50000 values, those behind aliases (*name) written out"),
        ("title: A tilted plane", "x: " + "[" * 900 + "]" * 900, "site.yaml:2: nested more than 20 levels deep"),
        ("title: A tilted plane", "x: " + "{a: " * 50000, "site.yaml:2: nested more than 20 levels deep"),
        ("title: A tilted plane", "x: &x [*x]", "site.yaml:2: nested too deeply, or an alias that holds itself (*x)"),
        ("thickness: 4.0", "thickness: !!bool abc", "site.yaml:9: the tag !!bool is not read"),
        (
            "thickness: 4.0",
            "thickness: !!python/object/apply:os.system [ls]",
            "!!python/object/apply:os.system is not read",
        ),
        ("thickness: 4.0", "thickness: !other 4", "site.yaml:9: the tag !other is not read"),
        ("thickness: 4.0", "thickness: 1" + "0" * 400, "site.yaml:9: release[0].thickness: a whole number of 401 digits"),
        ("thickness: 4.0", "thickness: " + "9" * 5000, "site.yaml:9: release[0].thickness: a whole number of 5000 digits"),
        ("members: 4", "members: 1" + "0" * 400, "site.yaml:19: ensemble.members: a whole number of 401 digits"),
        ("members: 4", "members: 4\n  seed: -1", "site.yaml:20: ensemble.seed: -1 is out of range; it must be at least 0"),
        ("title: A tilted plane", "<<: [1, 2]", "site.yaml:2: <<: keys that begin with < and merges are not read"),
        ("title: A tilted plane", "<uniform>: 3", "site.yaml:2: <uniform>: keys that begin with <"),
        ("title: A tilted plane", 'title: "\\uD800"', "site.yaml:2: title: holds a character that is no text"),
        ("title: A tilted plane", 'title: "a\\e[31m"', "site.yaml:2: title: holds a character that is no text"),
        ("inputs/dem.asc", "'**/x'", "site.yaml:4: terrain.dem: there is no file '**/x'"),
        ("inputs/dem.asc", "a**b", "site.yaml:4: terrain.dem: there is no file 'a**b'"),
        ("inputs/dem.asc", '"a\\0b"', "site.yaml:4: terrain.dem: holds a character that is no text"),
        ("inputs/dem.asc", "x" * 5000, "site.yaml:4: terrain.dem: there is no file 'xxx"),
        ("inputs/dem.asc", "/vsicurl/http://127.0.0.1:9/x", "site.yaml:4: terrain.dem: there is no file"),
        ("EPSG:32632", "EPSG:" + "9" * 400, "site.yaml:5: terrain.crs: 'EPSG:999"),
    ],
)
def test_what_no_site_holds_is_refused_with_its_line(edited, old, new, said):
    found = problems(edited(old, new))
    assert len(found) == 1
    assert said in found[0]
    assert len(found[0]) < 1000


def test_a_merge_of_an_anchor_at_the_top_is_refused(edited):
    found = problems(edited("title: A tilted plane", "base: &b {a: 1}\n<<: *b"))
    assert [line.split(": ")[1] for line in found] == ["base", "<<"]


def test_aliases_of_single_values_are_read(edited):
    settings = load(edited("thickness: 4.0", "thickness: &t 4.0").parent / "slope")
    assert settings.release[0].thickness == 4.0
    text = (edited("cell_size: 10", "cell_size: *t") / "site.yaml").read_text(encoding="utf-8")
    assert "*t" in text
    assert load(edited("cell_size: *t", "cell_size: *t")).simulation.cell_size == 4.0


def test_a_site_yaml_of_many_bytes_is_not_read(edited):
    (found,) = problems(edited("title: A tilted plane", "title: A tilted plane\n" + "# no site has so many lines\n" * 20_000))
    assert "more than 262144" in found


@pytest.mark.parametrize("named", [True, False])
def test_a_named_pipe_in_the_place_of_site_yaml_is_refused_at_once(tmp_path, named):
    os.mkfifo(tmp_path / "site.yaml")
    with pytest.raises(ConfigError, match=r"site\.yaml: is a named pipe, not a file"):
        site_file(tmp_path / "site.yaml" if named else tmp_path)


def test_a_name_that_no_file_can_have_is_no_site(tmp_path):
    for name in ("x" * 5000, "a\0b"):
        with pytest.raises(ConfigError, match="no such site"):
            site_file(tmp_path / name)


@pytest.mark.parametrize("size", ["1.0e+308", "1.0e+4", "120"])
def test_a_resolution_that_leaves_no_raster_is_refused(edited, size):
    with pytest.raises(ConfigError, match=r"terrain\.resolution: .*(fewer than 3 cells along a side|out of range)"):
        read_site(edited("  crs: EPSG:32632", f"  crs: EPSG:32632\n  resolution: {size}")).terrain()


@pytest.mark.parametrize(("name", "said"), [("pipe", "'inputs/pipe' is a named pipe"), ("/dev/zero", "'/dev/zero' is a device")])
@pytest.mark.parametrize("place", ["inputs/dem.asc", "inputs/release.geojson"])
def test_an_input_that_is_no_file_is_refused_by_every_command(edited, place, name, said):
    folder = edited(place, "inputs/pipe" if name == "pipe" else name)
    os.mkfifo(folder / "inputs" / "pipe")
    assert said in problems(folder)[0]


def test_a_pipe_beside_an_input_is_refused_before_it_is_hashed(site_folder):
    os.mkfifo(site_folder / "inputs" / "dem.prj")
    with pytest.raises(InputError, match=r"dem\.prj: is a named pipe"):
        read_site(site_folder).inputs()


def test_inputs_outside_the_folder_are_allowed_and_named(edited, tmp_path):
    (tmp_path / "dem.asc").write_bytes((tmp_path / "slope" / "inputs" / "dem.asc").read_bytes())
    found = inspect(edited("inputs/dem.asc", "../dem.asc"))
    assert found.problems == []
    assert f"../dem.asc: lies outside the folder of the site, at {tmp_path / 'dem.asc'}" in found.notes


def test_text_that_no_terminal_shows_is_written_out_and_long_text_is_cut_in_its_middle():
    assert shortened("a\nb\x1b\u200b") == "a\nb\\x1b\\u200b"
    whole, longer = "a" * SHOWN, "b" * SHOWN + "c" * SHOWN
    assert shortened(whole) == whole
    assert shortened(longer) == "b" * (SHOWN // 2) + " ... " + "c" * (SHOWN // 4)
    assert shortened(whole + "d") != whole + "d"


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ((), ""),
        (("release",), "release"),
        (("release", 0, "thickness"), "release[0].thickness"),
        (("a", "b", 2, 1), "a.b[2][1]"),
    ],
)
def test_a_place_is_written_with_points_and_brackets(place, text):
    assert dotted(place) == text
