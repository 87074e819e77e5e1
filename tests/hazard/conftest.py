import pytest
from synthetic_ensemble import Products, write_all


@pytest.fixture(scope="session")
def products(tmp_path_factory: pytest.TempPathFactory) -> Products:
    """Products of a site with a coordinate system."""
    return write_all(tmp_path_factory.mktemp("projected"), "EPSG:32616")


@pytest.fixture(scope="session")
def local_products(tmp_path_factory: pytest.TempPathFactory) -> Products:
    """Products of a site without one."""
    return write_all(tmp_path_factory.mktemp("local"), None)
