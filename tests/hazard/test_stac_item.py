"""``stac.json`` is a valid item whose assets are the files that were written."""

import json

import pystac
import pytest
from pystac.validation.stac_validator import JsonSchemaSTACValidator


def test_item_is_valid_and_lies_on_the_raster(products):
    path = products.results / "stac.json"
    item = pystac.Item.from_dict(json.loads(path.read_text()))
    JsonSchemaSTACValidator().validate_core(
        item.to_dict(include_self_link=False), pystac.STACObjectType.ITEM, pystac.get_stac_version()
    )
    west, south, east, _ = item.bbox
    assert (west, south) == pytest.approx((-84.35, 36.29), abs=0.1)
    assert (east - west) * 90e3 == pytest.approx(530, rel=0.1)  # 53 columns of 10 m
    assert item.properties["proj:code"] == "EPSG:32616"
    for asset in item.assets.values():
        assert asset.href == "./run.json" or (products.results / asset.href).is_file()
    assert "inundation_probability" in item.assets


def test_local_coordinates_have_no_item(local_products):
    assert not (local_products.results / "stac.json").exists()
