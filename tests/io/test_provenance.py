import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import runout
from runout.errors import StorageError
from runout.io.provenance import configuration_checksum, provenance


def make_record(folder: Path, **changes: object) -> dict:
    """Provenance of a folder with one input inside and one elsewhere."""
    site = folder / "site"
    (site / "inputs").mkdir(parents=True, exist_ok=True)
    (site / "inputs" / "dem.tif").write_bytes(b"elevations")
    (folder / "cached.tif").write_bytes(b"thicknesses")
    inputs = [site / "inputs" / "dem.tif", folder / "cached.tif"]
    configuration = {"file": site / "site.yaml", "density": np.float64(2000.0), "thresholds": (0.1, 1.0)}
    arguments = {"name": "valley", "folder": site, "inputs": inputs, "configuration": configuration, "seed": 3, "device": "cpu"}
    return provenance(**(arguments | changes))


def test_inputs_are_named_without_their_folder_and_checked_by_content(tmp_path: Path) -> None:
    record = make_record(tmp_path)
    assert record["inputs"] == [
        {"name": "inputs/dem.tif", "size": 10, "sha256": hashlib.sha256(b"elevations").hexdigest()},
        {"name": "cached.tif", "size": 11, "sha256": hashlib.sha256(b"thicknesses").hexdigest()},
    ]
    assert str(tmp_path) not in json.dumps(record["inputs"])


def test_the_record_is_plain_json_and_says_how_to_repeat_the_run(tmp_path: Path) -> None:
    record = json.loads(json.dumps(make_record(tmp_path, command=["runout", "run", "sites/valley"])))
    assert record["command"] == "runout run sites/valley"
    assert record["configuration"]["density"] == 2000.0
    assert (record["seed"], record["device"], record["runout"]) == (3, "cpu", runout.__version__)
    assert record["versions"]["numpy"] == np.__version__


def test_the_configuration_checksum_sees_values_but_not_their_order() -> None:
    checksum = configuration_checksum({"a": 1, "b": {"c": 2.0}})
    assert checksum == configuration_checksum({"b": {"c": 2.0}, "a": 1})
    assert checksum != configuration_checksum({"a": 1, "b": {"c": 2.5}})


def test_an_input_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"lost\.tif: this input cannot be read"):
        make_record(tmp_path, inputs=[tmp_path / "lost.tif"])
