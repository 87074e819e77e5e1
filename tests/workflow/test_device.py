"""--device: what is not there is refused in one line, auto takes what is there, and results do not depend on the choice's name."""

import pytest
from ramp_site import write_site

from runout import cli, read_site
from runout.backends.protocol import devices_of, find_device, get_backend
from runout.errors import DeviceError, ExitCode


@pytest.fixture
def ramp(tmp_path):
    return write_site(tmp_path / "ramp")


@pytest.fixture
def gpus(monkeypatch):
    """Pretend that the machine has these CUDA devices."""

    def pretend(*names):
        monkeypatch.setattr("runout.backends.protocol._cuda_devices", lambda: names)

    pretend()
    return pretend


@pytest.mark.parametrize("command", ["check", "run", "ensemble", "simulate"])
def test_device_that_is_not_there_is_one_line_that_names_what_is(command, ramp, gpus, capsys):
    assert cli.main([command, str(ramp), "--device", "cuda:0"]) == ExitCode.FAILURE
    said = " ".join(capsys.readouterr().err.split())
    assert "'cuda:0', which is not there; this machine has cpu" in said
    assert "Traceback" not in said
    assert not (ramp / "results").exists()


def test_auto_takes_the_gpus_and_else_the_cpu(ramp, gpus):
    site = read_site(ramp)
    assert site.on_device("auto").settings.simulation.backend == "scan"
    gpus("cuda:0", "cuda:1")
    found = site.on_device("auto").settings.simulation
    assert (found.backend, found.device) == ("hash", "cuda")


def test_second_gpu_is_taken_by_name_and_a_third_refused(ramp, gpus):
    gpus("cuda:0", "cuda:1")
    assert read_site(ramp).on_device("cuda:1").settings.simulation.device == "cuda:1"
    with pytest.raises(DeviceError, match="this machine has cuda:0, cuda:1, cpu"):
        read_site(ramp).on_device("cuda:2")


def test_where_a_member_is_computed_does_not_make_it_another_member(ramp, gpus):
    gpus("cuda:0")
    site = read_site(ramp)
    assert site.on_device("cuda:0").computed() == site.computed()
    assert site.on_device("cuda:0").resolved() != site.resolved()


def test_what_is_computed_does_make_it_another_member(ramp):
    site = read_site(ramp)
    coarser = site.settings.simulation.model_copy(update={"cell_size": 50.0})
    other = site.__class__(site.folder, site.file, site.name, site.settings.model_copy(update={"simulation": coarser}))
    assert other.computed() != site.computed()


@pytest.mark.parametrize(
    ("there", "wanted", "found"),
    [
        ((), "auto", "cpu"),
        (("cuda:0", "cuda:1"), "auto", "cuda:0"),
        (("cuda:0", "cuda:1"), "cuda", "cuda:0"),
        (("cuda:0", "cuda:1"), "cuda:1", "cuda:1"),
        (("cuda:0",), "cpu", "cpu"),
    ],
)
def test_a_device_is_found_by_its_name(gpus, there, wanted, found):
    gpus(*there)
    assert find_device(wanted) == found


def test_members_share_all_gpus_the_named_one_or_none(gpus):
    gpus("cuda:0", "cuda:1")
    assert devices_of("cuda") == ("cuda:0", "cuda:1")
    assert devices_of("cuda:1") == ("cuda:1",)
    assert devices_of("cpu") == ()


def test_a_backend_takes_the_device_that_it_can_use(gpus):
    def package(backend):
        return type(backend).__module__.split(".")[2]

    assert package(get_backend("auto")) == "scan"
    gpus("cuda:0")
    assert package(get_backend("auto", "cpu")) == "scan"
    assert package(get_backend("hash", "cpu")) == "hash"
    with pytest.raises(DeviceError, match="device is 'cuda'; backend 'scan' runs on 'cpu' only"):
        get_backend("scan", "cuda")
    with pytest.raises(DeviceError, match=r"backend is 'fast'; choose one of .*scan.*, auto"):
        get_backend("fast")


def test_a_name_that_no_device_can_have_is_a_wrong_option(ramp, gpus, capsys):
    assert cli.main(["check", str(ramp), "--device", "gpu"]) == ExitCode.CONFIGURATION
    assert "device is 'gpu'; choose cpu, auto, or a GPU such as cuda:0" in " ".join(capsys.readouterr().err.split())
