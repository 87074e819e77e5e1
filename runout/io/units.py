"""Units that files state, in the words that people write: of lengths by a rule, of other quantities from a table.

A length is a word for a unit in one of several languages and, before or after it, words on what the height refers to: ``m a.s.l.``,
``Meter über NN``, ``feet (NAVD88)``, ``US survey foot``.
"""

import re
import unicodedata
from collections.abc import Mapping

UNSTATED = frozenset(("", "1", "-", "unknown", "unspecified", "undefined", "not specified", "none", "n/a"))
US_FOOT, FOOT = 1200 / 3937, 0.3048
PREFIXES = {"m": 1e-3, "mili": 1e-3, "milli": 1e-3, "c": 0.01, "centi": 0.01, "zenti": 0.01, "d": 0.1, "deci": 0.1, "dezi": 0.1}
PREFIXES |= {"k": 1000.0, "kilo": 1000.0, "": 1.0}
METRE = re.compile(r"(mili|milli|[cz]enti|de[cz]i|kilo|)(?:met(?:er|ers|ern|re|res|ro|ros|ri|r|ry|row|ru|ra|ar|ara|era)|mts|mtrs?)")
METRE_SIGN = re.compile(r"([mcdk]?)m")


def _set(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\S+", text))


METRES_ELSEWHERE = _set("м метр метра метры метров μετρα μετρο 米 公尺 メートル")
FEET = _set("ft foot feet pied pieds pie pies piede piedi fuss voet fot stopa stopy stop pe pes фут футы футов フィート 英尺")
US_FEET = _set("sft usft ftus ussft sftus")
SURVEY = _set("us usa survey")
SEA_LEVEL = _set("sea msl amsl asl nn nhn nap ahd navd ngvd egm evrf")  # these words alone state a height reference and no unit
REFERENCES = SEA_LEVEL | _set("""
    above over mean mid sea level geoid geoidal ellipsoid ellipsoidal orthometric normal null height heights high
    altitude altitudes elevation elevations elev alt z datum vertical reference system in unit units value values the of
    to on wgs international intl int u ue uber ueber hohe hoehe hohen hoehen dem meer meere meeres meeresspiegel
    meereshohe mittel normalnull normalhohennull um ua ya au dessus du de la le les del della dello dei sur sobre el il
    lo nivel niveau livello sul sulla mer mare mar maris mari do al snm slm sm snmm ngf npm nm nmn nv nad poziomem morza
    morem hladinou more morja morya над уровнем моря boven zeeniveau taw tvd over havet oh ho havets niva havsytan ln od
    aod pd lat tp
""")
# a word that turns a length into something else, or says that it counts from elsewhere
OTHERWISE = _set("""
    per s sec secs second seconds h hr hour hours min day days year years yr square squared cubic cubed below under beneath down
    depth deep times x e or and ground agl terrain unter unterhalb sous sotto bajo abajo
""")
NAME = re.compile(r"[A-Z][A-Za-z]+\d{0,4}|[A-Za-z]{2,6}\d{2,4}")  # of a height reference: NAVD88, Kronstadt, ngf69
WORD = re.compile(r"[^\s_+,;:=\"'\-]+")

OTHER_UNITS: Mapping[str, Mapping[str, float]] = {  # by the unit used here, without spaces and in lower case; the factor to it
    "m/s": {"m/s": 1.0, "ms-1": 1.0, "km/h": 1 / 3.6, "kmh-1": 1 / 3.6, "kph": 1 / 3.6, "kmh": 1 / 3.6},
    "m/s2": {"m/s2": 1.0, "ms-2": 1.0},
    "Pa": {"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "n/m2": 1.0, "kn/m2": 1e3, "nm-2": 1.0, "knm-2": 1e3},
    "s": {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0},
    "deg": {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": 57.29577951308232, "radian": 57.29577951308232}
    | {"radians": 57.29577951308232},
    "": {},
}


def factor_to(unit: str, text: str | None) -> float | None:
    """What numbers in a stated unit are multiplied by; None if it is not a unit of such a quantity, 1 if the text states none.

    ``unit``: ``m``, a key of :data:`OTHER_UNITS`, or another unit that is used here and has no other word. ``text``: as a file
    states it.
    """
    if not is_stated(text):
        return 1.0
    if unit == "m":
        return metres_in(str(text))
    return OTHER_UNITS.get(unit, {_compact(unit): 1.0}).get(_compact(str(text)))


def is_stated(text: str | None) -> bool:
    """Whether a text states a unit; "unknown" does not, nor does a height reference alone, such as ``MSL``."""
    words = [_plain(word).rstrip("0123456789") for word in _words(text or "")]
    is_reference = all(word in REFERENCES for word in words) and not SEA_LEVEL.isdisjoint(words)
    return not (unicodedata.normalize("NFKC", text or "").strip().lower() in UNSTATED or is_reference)


def words_for(unit: str) -> str:
    """Words that are understood in the place of a unit, for messages."""
    return "m, ft, us-ft, km, dm, cm or mm" if unit == "m" else ", ".join(OTHER_UNITS.get(unit, {unit: 1.0})) or "none"


def metres_in(text: str) -> float | None:
    """Metres in the unit of a length, by its word and words on what it refers to; None if it is not understood.

    Every other word must name a height reference or be usual beside one, so that ``m/s``, ``m2``, ``10 m`` and ``m below ground``
    are not taken for metres.
    """
    if re.search(r"[/*^\u00d7\u00b7%]", text) or re.search(r"\d\s*m|m[\d²³]", text):
        return None
    words = _words(text)
    lengths = {size for word in words if (size := _length(word)) is not None}
    rest = [word for word in words if _length(word) is None]
    is_survey = bool(SURVEY & {_plain(word) for word in rest})
    if is_survey and lengths == {FOOT}:
        lengths, rest = {US_FOOT}, [word for word in rest if _plain(word) not in SURVEY]
    known = len(lengths) == 1 and _are_references(rest)
    return lengths.pop() if known else None


def _are_references(words: list[str]) -> bool:
    """Whether all words may stand beside a unit; a number of two to five digits follows a name, as in ``NAVD 88``."""
    for before, word in zip([None, *words], words, strict=False):
        numbered = before is not None and word.isdigit() and 2 <= len(word) <= 5 and len(before) > 1
        if not (numbered or _refers(word)):
            return False
    return True


def _refers(word: str) -> bool:
    plain = _plain(word)
    return plain not in OTHERWISE and (plain in REFERENCES or NAME.fullmatch(_without_marks(word)) is not None)


def _length(word: str) -> float | None:
    """Metres in a single word for a unit, which may be joined to a reference as in ``masl`` and ``mNN``; None for other words."""
    plain = _plain(word)
    if plain in FEET or plain in US_FEET:
        return FOOT if plain in FEET else US_FOOT
    named = METRE.fullmatch(plain) or METRE_SIGN.fullmatch(plain)
    if named:
        return PREFIXES[named[1]]
    if plain in METRES_ELSEWHERE:
        return 1.0
    if plain in REFERENCES or plain in OTHERWISE:
        return None
    for sign in ("ft", "m"):
        rest = _without_marks(word)[len(sign) :]
        joined = (
            len(rest) > 1 and _plain(rest) not in OTHERWISE and (_plain(rest) in REFERENCES or rest.isupper() or rest[-1].isdigit())
        )
        if plain.startswith(sign) and joined and _refers(rest):
            return FOOT if sign == "ft" else 1.0
    return None


def _words(text: str) -> list[str]:
    """Words of a text without brackets; single letters with dots or spaces between them are one word: ``s. l. m.``."""
    text = re.sub(r"[()\[\]{}<>]", " ", unicodedata.normalize("NFKC", text))
    words = WORD.findall(re.sub(r"(?<=[^\W\d])\.", " " if re.search(r"\w{3,}\.\w{3,}", text) else "", text))
    joined: list[str] = []
    for k, word in enumerate(words):
        is_letter = len(word) == 1 and word.isalpha()
        follows = is_letter and k > 1 and len(words[k - 1]) == 1 and words[k - 1].isalpha()
        joined = [*joined[:-1], joined[-1] + word] if follows else [*joined, word]
    return joined


def _plain(word: str) -> str:
    return _without_marks(word.casefold())


def _without_marks(word: str) -> str:
    return "".join(sign for sign in unicodedata.normalize("NFD", word) if not unicodedata.combining(sign))


def _compact(text: str) -> str:
    return re.sub(r"[\s_^·.()\[\]]|\*\*", "", unicodedata.normalize("NFKC", text).lower().replace(" per ", "/"))
