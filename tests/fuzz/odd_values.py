"""Odd values: what a file of somebody else may hold."""

import math
from random import Random

NUMBERS = [
    "0", "-1", "1", "3", "1e308", "-1e308", "1e-300", "1e400", ".nan", ".inf", "-.inf",
    "1" + "0" * 30, "1" + "0" * 400, "9" * 5000,
    "-0.0", "0x" + "f" * 60, "0o777", "1_000", "2.5e-5", "100000", "2147483648", "4.0", "1e9", "1e5", "1e-3",
]  # fmt: skip
TEXTS = [
    "~", "true", "no", "''", "' '", "x", "depth", "name", "2021-01-01", "2021-13-45", "2021-01-01T99:99:99Z", "'1e5'",
    "5 m", "4,0",
    "!!bool abc", "!!int x", "!foo 1", "!!python/object:os.system x", "*a", "&a 1", "&a [*a]", "<<", "'<block>'",
    "'\\u0000'", '"\\0"',
    '"\\uD800"', '"\\x1b[31m"', "|\n  x\n  y", "'" + "long" * 3000 + "'", "\u202etxt", "%", "@x", "`x`", "{", "[",
    "'", '"', ":", "- x",
]  # fmt: skip
PATHS = [
    "**/x", "'**/x'", "a**b", "'[x'", "../../../../etc/passwd", "/etc/passwd", "/dev/zero", "/dev/stdin", "inputs", ".",
    "..", "~/x",
    "inputs/pipe", "inputs/empty", "inputs/loop", "inputs/dem.tif/x", "NETCDF:inputs/dem.nc:z", "GTIFF_DIR:1:inputs/dem.tif",
    "/vsicurl/http://127.0.0.1:9/x.tif", "http://127.0.0.1:9/x.tif", "WMS:http://127.0.0.1:9/x", "matplotlib:../x", "matplotlib:",
    "{url: 'http://127.0.0.1:9/x', sha256: '" + "0" * 64 + "', size: 5}", "{url: 1, sha256: 2, size: [3]}", "{url: x}",
    "inputs/release.geojson", "inputs/dem.tif", "inputs/thickness.tif", "x" * 5000, "site.yaml", "con\nfused", "inputs\\dem.tif",
]  # fmt: skip
SYSTEMS = [
    None, "EPSG:32632", "EPSG:4326", "EPSG:3857", "EPSG:2056", "EPSG:5514", "EPSG:4978", "EPSG:5773", "EPSG:32632+5773",
    "EPSG:27700",
    "EPSG:2264", "EPSG:3995", "ESRI:54030", '+proj=ortho +lat_0=40', 'LOCAL_CS["x",UNIT["metre",1]]', "+proj=utm +zone=32 +south",
    "+proj=geos +h=35785831 +lon_0=0", "EPSG:4326+5773",
]  # fmt: skip
BLOCKS = [
    "[]", "{}", "[1, 2, 3]", "[1, 1e-300, 1]", "[[1]]", "{a: b}", "[~]", "[inputs/dem.tif]", "[{}]",
    "{distribution: uniform, low: 1, high: 2}",
    "{distribution: normal, mean: 20, standard_deviation: 1e-300}",
    "{distribution: discrete, values: [1e300], frequencies: [1e308, 1e308]}",
    "{distribution: triangular, low: 0, mode: 1e-320, high: 1}", "{distribution: normal, mean: 1e308, standard_deviation: 1e308}",
    "{law: elastic, density: 2000, youngs_modulus: 1e6}", "{distribution: x}", "{? [a] : b}", "[" * 900 + "]" * 900,
    "{distribution: normal, mean: 20, standard_deviation: 5, low: 19.9999999, high: 20}", "[0.1, 0.1]", "[1e-300, 1e300]",
]  # fmt: skip
FLOATS = [
    0.0, -0.0, 1.0, -1.0, 4.0, 1e-300, 1e300, 1e308, -1e308, math.nan, math.inf, -math.inf, 1e-9, 1e9, 1e20, -9999.0,
    3.4e38, 32767.0,
    1e-5, 1000.0, 0.3, 5e-324,
]  # fmt: skip


def scalar(random: Random) -> str:
    """A value of YAML, hardly ever the right one."""
    return random.choice(random.choice([NUMBERS, NUMBERS, TEXTS, PATHS, BLOCKS, [str(s) for s in SYSTEMS]]))


def mutated(data: bytes, random: Random) -> bytes:
    """Bytes of a file, damaged: cut, flipped, doubled, filled or empty."""
    data = bytearray(data)
    for _ in range(random.choice([1, 1, 2, 8])):
        if not data:
            break
        at, length = random.randrange(len(data)), random.choice([1, 1, 2, 4, 8, 64])
        kind = random.choice(["cut", "flip", "flip", "double", "zero", "ones", "random", "drop"])
        if kind == "cut":
            del data[at:]
        elif kind == "flip":
            data[at] ^= 1 << random.randrange(8)
        elif kind == "double":
            data[at:at] = data[at : at + length]
        elif kind == "drop":
            del data[at : at + length]
        else:
            fill = {"zero": b"\0", "ones": b"\xff", "random": random.randbytes(1)}[kind]
            data[at : at + length] = fill * len(data[at : at + length])
    return bytes(data)
