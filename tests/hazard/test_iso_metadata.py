"""``metadata.xml`` is a record of ISO 19115 that a library for catalogues reads, with all mandatory elements."""

from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from synthetic_ensemble import make_site, make_table

from runout.hazard.writers.iso_metadata import GCO, GMD, lineage

MANDATORY = (  # of a data set, ISO 19115:2003, table 3
    *(
        "fileIdentifier",
        "language",
        "contact",
        "dateStamp",
        "identificationInfo//citation//title",
        "identificationInfo//citation//date",
    ),
    *("identificationInfo//abstract", "identificationInfo//language", "identificationInfo//topicCategory"),
    *("identificationInfo//EX_GeographicBoundingBox", "referenceSystemInfo", "dataQualityInfo//statement", "distributionInfo"),
)


def record(results):
    return ElementTree.parse(results / "metadata.xml").getroot()


def path(text):
    """Path of ElementTree with the namespace of ISO."""
    return "//".join("/".join(f"{{{GMD}}}{name}" for name in part.split("/")) for part in text.split("//"))


@pytest.mark.parametrize("name", MANDATORY)
def test_each_mandatory_element_has_content(products, name):
    element = record(products.results).find(path(name))
    assert element is not None
    assert list(element) or element.text or element.get(f"{{{GCO}}}nilReason")


def test_a_library_for_catalogues_reads_title_extent_system_and_lineage(products):
    owslib_iso = pytest.importorskip("owslib.iso")
    parsed = pytest.importorskip("lxml.etree").parse(products.results / "metadata.xml")
    record = owslib_iso.MD_Metadata(parsed.getroot())
    assert record.identification[0].title == "A made-up valley: hazard maps"
    box = record.identification[0].bbox
    assert (float(box.minx), float(box.miny)) == pytest.approx((-84.35, 36.29), abs=0.1)
    assert float(box.maxx) > float(box.minx)
    assert (record.referencesystem.code, record.referencesystem.codeSpace) == ("32616", "EPSG")
    assert "inputs/dem.tif (SHA-256 " in record.dataquality.lineage
    assert "3 of 5 members are valid" in record.dataquality.lineage
    assert record.identification[0].topiccategory == ["geoscientificInformation"]


def test_a_contact_that_nobody_states_is_marked_as_missing(products):
    name = record(products.results).find(path("contact/CI_ResponsibleParty/organisationName"))
    assert name.get(f"{{{GCO}}}nilReason") == "missing"


def test_author_licence_and_purpose_are_those_of_the_site(tmp_path):
    from runout.hazard.products import write_products

    site, results = make_site(tmp_path)
    contact = {
        "author": "A. Author",
        "email": "a@example.org",
        "institution": "Office & Sons",
        "license": "CC-BY-4.0",
        "purpose": "a < b",
    }
    site.settings.metadata = SimpleNamespace(model_dump=lambda exclude_none: contact)
    write_products(site, results, make_table(), None)
    texts = [element.text for element in record(results).iter(f"{{{GCO}}}CharacterString")]
    assert set(contact.values()) <= set(texts)


def test_local_coordinates_have_no_record(local_products):
    assert not (local_products.results / "metadata.xml").exists()


def test_changes_of_inputs_are_part_of_the_lineage():
    attrs = {"source": "runout 1", "ensemble": "4 members", "inputs": "[]", "configuration_sha256": "ab"}
    assert not any("Changes" in line for line in lineage(attrs))
    assert "Changes of inputs: filled 3 cells." in list(lineage(attrs | {"changes_of_inputs": "filled 3 cells"}))
