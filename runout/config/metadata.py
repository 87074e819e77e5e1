"""Author and purpose of a study, for the head of the report and the metadata of the products."""

from runout.config.distributions import Settings, quantity

_LONGEST = 500  # characters


def _text(description: str, **bounds: str) -> str | None:
    return quantity(description, None, min_length=1, max_length=_LONGEST, **bounds)  # type: ignore[no-any-return]


class MetadataSettings(Settings):
    """Author and purpose of the study. All keys are optional; the products contain only those that are stated."""

    author: str | None = _text("who is responsible for the study")
    email: str | None = _text("address of the author", pattern=r"^[^@\s]+@[^@\s]+$", hint="name@example.org")
    url: str | None = _text("page of the author, for example an ORCID", pattern=r"^https?://", hint="begin with https://")
    institution: str | None = _text("where the study was made")
    project: str | None = _text("project that it belongs to")
    purpose: str | None = _text("what the maps are for, and what not")
    license: str | None = _text("licence of the products, for example CC-BY-4.0")
    references: str | None = _text("reports and papers that describe the case")
    acknowledgement: str | None = _text("who is to be named as the source of the inputs")


METADATA = quantity(
    "who made the study and what for: author, email, url, institution, project, purpose, license, references, acknowledgement",
    None,
    examples=[{"author": "A. Name", "institution": "Survey", "purpose": "screening"}],
)
