"""`runout schemes`: the list, one scheme as its file has it, and names that are not known."""

from runout import cli
from runout.config.scheme import FOLDER, names, read_scheme
from runout.errors import ExitCode


def test_all_schemes_are_listed_with_title_and_state(capsys):
    assert cli.main(["schemes"]) == ExitCode.OK
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(path.stem for path in FOLDER.glob("*.yaml"))
    for line, name in zip(lines, names(), strict=True):
        assert read_scheme(name).title in line
        assert "checked: " in line


def test_a_scheme_is_printed_as_its_file_so_that_it_can_be_copied(tmp_path, capsys):
    assert cli.main(["schemes", "swiss_flood"]) == ExitCode.OK
    copy = tmp_path / "mine.yaml"
    copy.write_text(capsys.readouterr().out, encoding="utf-8")
    assert copy.read_bytes() == (FOLDER / "swiss_flood.yaml").read_bytes()
    assert read_scheme("mine.yaml", tmp_path) == read_scheme("swiss_flood")


def test_an_unknown_scheme_is_refused_with_the_nearest_name(capsys):
    assert cli.main(["schemes", "swiss_floods"]) == ExitCode.CONFIGURATION
    assert "did you mean 'swiss_flood'?" in capsys.readouterr().err
