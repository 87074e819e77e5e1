"""Options that name a cluster: connections that are not encrypted and incomplete certificates are refused."""

import pytest

from runout.ensemble.cluster import Cluster
from runout.errors import ClusterError, ConfigError, ExitCode

TLS = "tls://host:8786"


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"scheduler": "tcp://host:8786"}, "everyone who reaches this scheduler can run programs as you; .* --allow-unencrypted"),
        ({"scheduler": "host:8786"}, "no address of a scheduler; state tls://host:port"),
        ({"scheduler": "tls://host"}, "no address of a scheduler"),
        ({"scheduler": "ws://host:80"}, "no address of a scheduler"),
        ({"scheduler": ""}, "no address of a scheduler"),
        ({"scheduler": TLS, "slurm": 2}, "two clusters; state one of them"),
        ({"slurm": 0}, "--slurm is 0; at least 1 job is needed"),
        ({"allow_unencrypted": True}, "--allow-unencrypted needs --scheduler"),
    ],
)
def test_an_unsafe_or_unclear_cluster_is_refused(stated, message):
    with pytest.raises(ConfigError, match=message) as error:
        Cluster(**stated)
    assert error.value.exit_code is ExitCode.CONFIGURATION


def test_certificates_are_stated_together_and_exist(tmp_path):
    paths = {name: tmp_path / name for name in ("tls_ca", "tls_cert", "tls_key")}
    with pytest.raises(ConfigError, match="--tls-ca: there is no file"):
        Cluster(TLS, **paths)
    for path in paths.values():
        path.touch()
    assert Cluster(TLS, **paths)
    with pytest.raises(ConfigError, match="--tls-ca and --tls-key without --tls-cert; state all three"):
        Cluster(TLS, **{**paths, "tls_cert": None})
    with pytest.raises(ConfigError, match="--tls-ca needs --scheduler"):
        Cluster(**paths)
    with pytest.raises(ConfigError, match="certificates are for tls:// only"):
        Cluster("tcp://host:8786", **paths, allow_unencrypted=True)


def test_no_option_is_no_cluster():
    assert not Cluster()
    assert Cluster(TLS)
    assert Cluster(slurm=1)
    assert Cluster("tcp://host:8786", allow_unencrypted=True)


def test_a_library_that_is_not_installed_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    message = r"distributed is not installed; install it: pip install 'runout\[cluster\]'"
    with pytest.raises(ClusterError, match=message), Cluster(TLS).connect(tmp_path):
        pass


def test_an_encrypted_address_without_certificates_is_refused(tmp_path):
    pytest.importorskip("distributed", reason="distributed is not installed")
    with (
        pytest.raises(ConfigError, match=r"no certificates; state --tls-ca, .* or set distributed.comm.tls"),
        Cluster(TLS).connect(tmp_path),
    ):
        pass
