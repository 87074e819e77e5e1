"""``metadata.xml``: metadata of hazard.nc for catalogues (ISO 19115 as ISO 19139 XML): title, extent, system, lineage, contact."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from runout.hazard.writers import Products
from runout.io.atomic import write_text
from runout.io.grid import horizontal_crs

NAME = "metadata.xml"
GMD, GCO = "http://www.isotc211.org/2005/gmd", "http://www.isotc211.org/2005/gco"
CODES = "http://standards.iso.org/iso/19139/resources/gmxCodelists.xml"
STANDARD, EDITION = "ISO 19115:2003 Geographic information - Metadata", "2003"
NOT_STATED = "missing"  # reason of ISO for a mandatory element whose value nobody states


def write(products: Products) -> list[Path]:
    """Path of the file; none for local coordinates, which have no place on the globe."""
    if products.terrain.crs is None:
        return []
    root = metadata(products)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
    return [write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', products.results / NAME)]


def earlier(results: Path) -> set[Path]:
    """The file of an earlier run."""
    return {path for path in [results / NAME] if path.is_file()}


def metadata(products: Products) -> ElementTree.Element:
    """The record: what ISO requires of a data set, in its order; elements without a stated value say so."""
    ElementTree.register_namespace("gmd", GMD)
    ElementTree.register_namespace("gco", GCO)
    attrs = {str(name): value for name, value in products.hazard.attrs.items()}
    date = str(attrs["date_created"])[:10]
    root = ElementTree.Element(f"{{{GMD}}}MD_Metadata")
    _text(root, "fileIdentifier", str(attrs["id"]))
    _text(root, "language", "eng")
    _code(root, "characterSet", "MD_CharacterSetCode", "utf8")
    _code(root, "hierarchyLevel", "MD_ScopeCode", "dataset")
    _contact(root, "contact", attrs)
    _text(root, "dateStamp", date, "Date")
    _text(root, "metadataStandardName", STANDARD)
    _text(root, "metadataStandardVersion", EDITION)
    _system(root, str(products.terrain.crs))
    _identification(_inside(root, "identificationInfo", "MD_DataIdentification"), attrs, date)
    form = _inside(root, "distributionInfo", "MD_Distribution", "distributionFormat", "MD_Format")
    _text(form, "name", "NetCDF-4, conventions CF and ACDD")
    _text(form, "version", str(attrs["Conventions"]))
    quality = _inside(root, "dataQualityInfo", "DQ_DataQuality")
    _code(_inside(quality, "scope", "DQ_Scope"), "level", "MD_ScopeCode", "dataset")
    _text(_inside(quality, "lineage", "LI_Lineage"), "statement", " ".join(lineage(attrs)))
    return root


def _identification(block: ElementTree.Element, attrs: Mapping[str, Any], date: str) -> None:
    citation = _inside(block, "citation", "CI_Citation")
    _text(citation, "title", str(attrs["title"]))
    created = _inside(citation, "date", "CI_Date")
    _text(created, "date", date, "Date")
    _code(created, "dateType", "CI_DateTypeCode", "creation")
    _text(block, "abstract", str(attrs["summary"]))
    if "purpose" in attrs:
        _text(block, "purpose", str(attrs["purpose"]))
    _contact(block, "pointOfContact", attrs)
    keywords = _inside(block, "descriptiveKeywords", "MD_Keywords")
    for word in str(attrs["keywords"]).split(", "):
        _text(keywords, "keyword", word)
    if "license" in attrs:
        limits = _inside(block, "resourceConstraints", "MD_LegalConstraints")
        _code(limits, "useConstraints", "MD_RestrictionCode", "otherRestrictions")
        _text(limits, "otherConstraints", str(attrs["license"]))
    _code(block, "spatialRepresentationType", "MD_SpatialRepresentationTypeCode", "grid")
    resolution = float(str(attrs["geospatial_lat_resolution"]).split()[0])
    distance = _inside(block, "spatialResolution", "MD_Resolution", "distance")
    ElementTree.SubElement(distance, f"{{{GCO}}}Distance", {"uom": "m"}).text = f"{resolution:g}"
    _text(block, "language", "eng")
    ElementTree.SubElement(_inside(block, "topicCategory"), f"{{{GMD}}}MD_TopicCategoryCode").text = "geoscientificInformation"
    box = _inside(block, "extent", "EX_Extent", "geographicElement", "EX_GeographicBoundingBox")
    edges = {"westBoundLongitude": "lon_min", "eastBoundLongitude": "lon_max"}
    for name, edge in (edges | {"southBoundLatitude": "lat_min", "northBoundLatitude": "lat_max"}).items():
        _text(box, name, f"{float(attrs[f'geospatial_{edge}']):.7f}", "Decimal")


def lineage(attrs: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on how the maps were made: program, ensemble, input files with checksums, changes."""
    yield f"Made by {attrs['source']}, from an ensemble of simulations: {attrs['ensemble']}."
    inputs = json.loads(str(attrs["inputs"]))
    if inputs:
        yield "Inputs: " + ", ".join(f"{one['name']} (SHA-256 {one['sha256']})" for one in inputs) + "."
    if attrs.get("changes_of_inputs"):
        yield f"Changes of inputs: {attrs['changes_of_inputs']}."
    yield f"Settings: SHA-256 {attrs['configuration_sha256']}, in full in run.json and in hazard.nc."
    if attrs.get("acknowledgement"):
        yield f"Acknowledgement: {attrs['acknowledgement']}"


def _contact(parent: ElementTree.Element, name: str, attrs: Mapping[str, Any]) -> None:
    """Responsible party: author, institution and address as site.yaml states them under ``metadata``."""
    party = _inside(parent, name, "CI_ResponsibleParty")
    person = attrs.get("creator_name") if attrs.get("creator_type") == "person" else None
    institution = attrs.get("institution")
    if person:
        _text(party, "individualName", str(person))
    if institution or not person:
        _text(party, "organisationName", str(institution) if institution else None)
    address = {key: attrs[key] for key in ("creator_email", "creator_url") if key in attrs}
    if address:
        contact = _inside(party, "contactInfo", "CI_Contact")
        if "creator_email" in address:
            _text(_inside(contact, "address", "CI_Address"), "electronicMailAddress", str(address["creator_email"]))
        if "creator_url" in address:
            linkage = _inside(contact, "onlineResource", "CI_OnlineResource", "linkage")
            ElementTree.SubElement(linkage, f"{{{GMD}}}URL").text = str(address["creator_url"])
    _code(party, "role", "CI_RoleCode", "pointOfContact")


def _system(root: ElementTree.Element, crs: str) -> None:
    """Coordinate reference system: authority and number, or the text of a system that has none."""
    horizontal = horizontal_crs(crs)
    authority = horizontal.to_authority()
    identifier = _inside(root, "referenceSystemInfo", "MD_ReferenceSystem", "referenceSystemIdentifier", "RS_Identifier")
    _text(identifier, "code", authority[1] if authority else horizontal.to_wkt())
    if authority:
        _text(identifier, "codeSpace", authority[0])


def _inside(parent: ElementTree.Element, *names: str) -> ElementTree.Element:
    """New element within new elements of these names."""
    for name in names:
        parent = ElementTree.SubElement(parent, f"{{{GMD}}}{name}")
    return parent


def _text(parent: ElementTree.Element, name: str, value: str | None, kind: str = "CharacterString") -> None:
    """New element with a value of a type of ISO; one without a value has the reason why."""
    element = ElementTree.SubElement(parent, f"{{{GMD}}}{name}", {} if value else {f"{{{GCO}}}nilReason": NOT_STATED})
    if value:
        ElementTree.SubElement(element, f"{{{GCO}}}{kind}").text = value


def _code(parent: ElementTree.Element, name: str, kind: str, value: str) -> None:
    """New element with a value of a code list."""
    attributes = {"codeList": f"{CODES}#{kind}", "codeListValue": value}
    ElementTree.SubElement(_inside(parent, name), f"{{{GMD}}}{kind}", attributes).text = value
