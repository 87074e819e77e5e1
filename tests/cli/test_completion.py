"""`runout --install-completion`: scripts of the shells complete every command, options, and folders of sites."""

import os
import shutil
import subprocess

import pytest

from runout import cli
from runout.errors import ExitCode

NAMES = {command.__name__.replace("_", "-") for command in cli.COMMANDS}
BASH = """
source {script}
COMP_WORDS=({words})
COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
_runout
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
FISH = "source {script}; complete -C '{line}'"


def offered(shell, script, folder, *words):
    """What a shell offers for the last of some words, which is not finished, one a line."""
    quoted = " ".join(f'"{word}"' for word in words)
    text = {"bash": BASH, "fish": FISH}[shell].format(script=script, words=quoted, line=" ".join(words))
    done = subprocess.run([shell, "-c", text], cwd=folder, capture_output=True, text=True, check=False, timeout=60)
    assert done.stderr == ""
    return [option.split("\t")[0] for option in done.stdout.splitlines()]


@pytest.fixture(params=["bash", "zsh", "fish"])
def completed(request, tmp_path, monkeypatch, capsys):
    """Shell, its script, and a folder with the site ``ramp``; all below a home folder of its own."""
    monkeypatch.setenv("HOME", str(tmp_path))
    script = tmp_path / "runout.completion"
    assert cli.main(["--install-completion", "--shell", request.param, "--output", str(script)]) == ExitCode.OK
    assert str(script) in capsys.readouterr().out
    (tmp_path / "sites" / "ramp").mkdir(parents=True)
    return request.param, script, tmp_path / "sites"


def test_script_names_every_command(completed):
    text = completed[1].read_text()
    assert [name for name in NAMES if name not in text] == []


def test_shell_offers_commands_options_and_folders(completed):
    shell, script, folder = completed
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    subprocess.run([shell, "-n", str(script)], check=True)
    if shell == "zsh":  # its completion system runs on a terminal only
        return
    assert set(offered(shell, script, folder, "runout", "")) >= NAMES
    assert offered(shell, script, folder, "runout", "what") == ["what-if"]
    assert "--one-at-a-time" in offered(shell, script, folder, "runout", "what-if", "--one")
    assert [name.rstrip("/") for name in offered(shell, script, folder, "runout", "run", "ra")] == ["ramp"]


def test_completion_starts_with_the_shell(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cli.main(["--install-completion", "--shell", "bash"]) == ExitCode.OK
    assert "runout" in capsys.readouterr().out
    loaded = (tmp_path / ".bashrc").read_text()
    environment = {**os.environ, "HOME": str(tmp_path)}
    shown = subprocess.run(["bash", "-c", f"{loaded}\ncomplete -p runout"], env=environment, capture_output=True, text=True)
    assert shown.stdout.strip() == "complete -F _runout runout"
