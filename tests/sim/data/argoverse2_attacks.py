"""Makes files of Argoverse 2 that hurt: tables that unfold, and maps without end."""

import functools
import gzip
import struct
from typing import Any

import numpy as np
import orjson
import pyarrow

from tests.sim.data import argoverse2_files, files

WANTED = files.scenario(num_steps=13)
NUM_ROWS = int(WANTED.tracks.valid.sum())
DEEP = 1 << 17  # containers in one another
MANY = 1 << 20  # as many of one kind as pyarrow reads of a list
COLUMN = b"\x26\x00\x00"  # the least that tells of a column, in Thrift
ABSURD_COUNTS = (0, -1, 1000, 10**6, 2**62)


def table(options: dict[str, Any] | None = None, **changed: Any) -> bytes:
    """Encodes a scenario with some columns replaced, left out where None."""
    columns = argoverse2_files.columns(WANTED) | changed
    told = {name: column for name, column in columns.items() if column is not None}
    return argoverse2_files.table(told, **options or {})


def varint(value: int) -> bytes:
    """Encodes a number as Thrift does, seven bits a byte."""
    groups = [value >> shift & 127 for shift in range(0, max(value.bit_length(), 1), 7)]
    return bytes([group | 128 for group in groups[:-1]] + groups[-1:])


def integer(value: int) -> bytes:
    """Encodes a field of Thrift, the one after the last, that is an integer."""
    return b"\x16" + varint(((value << 1) ^ (value >> 63)) & (2**64 - 1))


def structs(number: int) -> bytes:
    """Encodes a field of Thrift, the one after the last, that lists structs."""
    return b"\x19\xfc" + varint(number)


def with_footer(record: bytes, footer: bytes) -> bytes:
    """Returns a table with another footer."""
    length = int.from_bytes(record[-8:-4], "little")
    body = record[: len(record) - 8 - length]
    return body + footer + struct.pack("<I", len(footer)) + record[-4:]


def footers() -> dict[str, bytes]:
    """Returns tables whose footers lie, or ask for gigabytes."""
    plain = table({"compression": "none"})
    footer = plain[-8 - int.from_bytes(plain[-8:-4], "little") : -8]
    leaf, root = b"\x15\x0a\x25\x00\x18\x01x\x00", b"\x48\x01r\x15\x02\x00"
    schema = b"\x15\x02" + structs(2) + root + leaf + integer(1)
    end = integer(0) + integer(1) + b"\x00"
    group = structs(MANY) + COLUMN * MANY + end
    fitting = structs(80_000) + COLUMN * 80_000 + end
    assert footer.count(integer(NUM_ROWS)) > 2
    heads = {
        f"{n} rows, told {places} times": footer.replace(
            integer(NUM_ROWS), integer(n), places
        )
        for n in ABSURD_COUNTS
        for places in (1, 2, -1)
    }
    farthest = struct.pack("<d", float(WANTED.tracks.yaw[WANTED.tracks.valid].max()))
    heads |= {
        "statistics that are not so": footer.replace(farthest, b"\xff" * 8),
        "a deep footer": b"\x1c" * DEEP,
        "lists in a footer": b"\x19" * (DEEP - 1),
        "a text beyond the footer": b"\x18" + b"\xff" * 9 + b"\x01",
        "many columns": schema + structs(8) + group * 8 + b"\x00",
        "columns that fit": schema + structs(1) + fitting + b"\x00",
        "many groups": schema + structs(MANY) + (b"\x19\x0c" + end) * MANY,
        "groups that are not there": schema + structs(2**31 - 1),
        "columns named again": footer.replace(b"position_y", b"position_x"),
        "columns of another kind": footer.replace(b"\x15\x0a", b"\x15\x0c"),
    }
    told = {name: with_footer(plain, content) for name, content in heads.items()}
    for length in (0, 7, len(plain) + 1, 2**31, 2**32 - 1):
        told[f"a footer of {length}"] = plain[:-8] + struct.pack("<I", length) + b"PAR1"
    return told


def wrong_columns() -> dict[str, bytes]:
    """Returns tables whose columns are none, or of another kind."""
    place = argoverse2_files.columns(WANTED)["position_x"]
    name = "position_x"
    kinds = {
        "lists": [[1.0]] * NUM_ROWS,
        "lists of nothing": pyarrow.array(
            [[]] * NUM_ROWS, pyarrow.list_(pyarrow.float64())
        ),
        "structs": [{name: 1.0}] * NUM_ROWS,
        "mappings": pyarrow.array(
            [[("a", 1.0)]] * NUM_ROWS, pyarrow.map_(pyarrow.string(), pyarrow.float64())
        ),
        "times": pyarrow.array([1] * NUM_ROWS, pyarrow.timestamp("ns")),
        "decimals": pyarrow.array([1] * NUM_ROWS, pyarrow.decimal128(38, 2)),
        "texts": ["nan"] * NUM_ROWS,
        "bytes": [b"\xff\xfe"] * NUM_ROWS,
        "halves": place.astype(np.float16),
        "nothing": pyarrow.nulls(NUM_ROWS),
        "no numbers": place * np.nan,
        "infinities": place + np.inf,
        "the largest": np.full(NUM_ROWS, 1.7e308),
    }
    found = {f"places as {kind}": table(**{name: kinds[kind]}) for kind in kinds}
    told = argoverse2_files.columns(WANTED)
    found |= {f"without {column}": table(**{column: None}) for column in told}
    for column in ("track_id", "object_type", "scenario_id"):
        inner = pyarrow.array([{column: "x"}] * NUM_ROWS)
        found[f"{column} within another"] = table(**{column: None, "a": inner})
        words = pyarrow.array([b"\xff\xc0"] * NUM_ROWS).view("string")
        found[f"{column} of bytes that are no UTF-8"] = table(**{column: words})
    return found | {
        "a place within another": table(position_x=None, a=kinds["structs"]),
        "ids as wide as they may be": table(
            timestep=np.full(NUM_ROWS, 2**63, np.uint64)
        ),
        "a path as an id": table(scenario_id=["../../etc/passwd"] * NUM_ROWS),
        "a long id": table(scenario_id=["9" * (1 << 20)] * NUM_ROWS),
        "numbers of many digits": table(track_id=["9" * 5000] * NUM_ROWS),
        "the last steps": table(timestep=np.arange(NUM_ROWS) + 2**62),
        "steps before all": table(timestep=np.arange(NUM_ROWS) - 2**62),
    }


def large_tables() -> dict[str, bytes]:
    """Returns tables that unfold to much, or have as many rows as there may be."""
    codes = pyarrow.array(np.arange(NUM_ROWS, dtype=np.int8) % 3)
    words = pyarrow.DictionaryArray.from_arrays(codes, ["vehicle", "bus", "static"])
    plain = table({"compression": "none"}, object_type=words)
    whole = NUM_ROWS // 8 * 8  # codes of two bits, eight at once
    packed = sum((i % 3) << 2 * i for i in range(whole)).to_bytes(whole // 4, "little")
    assert plain.count(packed) == 1
    long = pyarrow.array(["x" * (65 << 20)])
    row = {
        name: column[:1] for name, column in argoverse2_files.columns(WANTED).items()
    }
    most = 10**6

    def repeated(num_rows: int, **changed: Any) -> bytes:
        same = {
            name: pyarrow.array(column)
            .dictionary_encode()
            .take(pyarrow.array(np.zeros(num_rows, np.int8)))
            for name, column in row.items()
        }
        return argoverse2_files.table(same | changed)

    return {
        "codes beyond the words": plain.replace(packed, b"\xff" * len(packed)),
        "a long text": table(
            {"compression": "zstd", "use_dictionary": False},
            city=pyarrow.concat_arrays(
                [long] + [pyarrow.array(["x"])] * (NUM_ROWS - 1)
            ),
        ),
        "a long name": table(
            {"compression": "zstd"},
            track_id=pyarrow.concat_arrays(
                [long] + [pyarrow.array(["x"])] * (NUM_ROWS - 1)
            ),
        ),
        "too many rows": repeated(most + 1),
        "one row many times": repeated(most),
        "many steps": repeated(200_000, timestep=np.arange(200_000)),
        "a row a group": table({"row_group_size": 1}),
        "a page a row": table({"data_page_size": 1, "write_batch_size": 1}),
        "zeros": gzip.compress(b"PAR1", mtime=0) + zeros(),
    }


@functools.cache
def zeros() -> bytes:
    """Returns 200 MB of zeros in 200 kB of gzip."""
    return gzip.compress(bytes(1 << 20), mtime=0) * 200


def tables() -> dict[str, bytes]:
    """Returns parquet files that hurt."""
    return footers() | wrong_columns() | large_tables()


def maps() -> dict[str, bytes]:
    """Returns maps that hurt."""
    document = argoverse2_files.map_document(WANTED)
    whole = orjson.dumps(document)
    head, tail = b'{"lane_segments": ', b', "drivable_areas": {}}'
    return (
        large_maps()
        | rings()
        | {
            "no JSON": b"{",
            "an array": b"[]",
            "not UTF-8": whole.replace(b"VEHICLE", b"\xff\xfe"),
            "UTF-16": whole.decode().encode("utf-16"),
            "a mark before": b"\xef\xbb\xbf" + whole,
            "deep lists": head + b"[" * DEEP,
            "deep mappings": head + b'{"a":' * DEEP,
            "deep and closed": head + b"[" * DEEP + b"]" * DEEP + tail,
            "many lists": head + b"[" + b"[]," * (10 << 20) + b"[]]" + tail,
            "many numbers": head + b"[" + b"1," * (20 << 20) + b"1]" + tail,
            "a long integer": whole.replace(b'"id":11', b'"id":' + b"1" * (1 << 20)),
            "an id beyond 64 bits": whole.replace(
                b'"id":11', b'"id":9223372036854775808'
            ),
            "ids that are the same": whole.replace(b'"id":12', b'"id":11'),
            "a fraction as an id": whole.replace(b'"id":11', b'"id":11.5'),
            "no number": whole.replace(b'"y":', b'"y":NaN,"a":', 1),
            "an infinity": whole.replace(b'"y":', b'"y":1e999,"a":', 1),
            "the largest number": whole.replace(b'"y":', b'"y":1e308,"a":'),
            "a place far away": whole.replace(b'"y":', b'"y":9999999,"a":', 1),
            "no lanes": orjson.dumps(document | {"lane_segments": {}}),
            "zeros": gzip.compress(b"{", mtime=0) + zeros(),
        }
    )


def place(x: float, y: float) -> dict[str, float]:
    """Returns a point of a map."""
    return {"x": x, "y": y, "z": 0.0}


def large_maps() -> dict[str, bytes]:
    """Returns maps of more lanes than a city has."""
    document = argoverse2_files.map_document(WANTED)
    (lane, *_) = document["lane_segments"].values()
    short = lane | {
        "left_lane_boundary": [place(0.0, 1.0), place(1.0, 1.0)],
        "right_lane_boundary": [place(0.0, 0.0), place(1.0, 0.0)],
    }

    def lanes(number: int, **changed: Any) -> bytes:
        text = orjson.dumps(short | {"id": 7777} | changed)
        members = (
            b'"%d":' % i + text.replace(b'"id":7777', b'"id":%d' % i)
            for i in range(number)
        )
        rest = {name: document[name] for name in list(document)[1:]}
        return (
            b'{"lane_segments":{' + b",".join(members) + b"}," + orjson.dumps(rest)[1:]
        )

    head = b'{"lane_segments":{'
    crossing = {"id": 5, "edge1": [place(0, 0)], "edge2": [place(1, 1)]}
    return {
        "a million lanes": head + (b'"1":' + orjson.dumps(short) + b",") * 10**5,
        "lanes at one place": lanes(4000),
        "lanes after a lane": lanes(4000, successors=[7], predecessors=[7]),
        "a lane after lanes": lanes(1, predecessors=list(range(10**5))),
        "lanes after lanes": lanes(300, predecessors=list(range(300))),
        "a long lane": lanes(1, left_lane_boundary=[place(0, 0), place(499_000, 0)]),
        "long lanes": lanes(99, left_lane_boundary=[place(0, 0), place(5000, 0)]),
        "many crossings": orjson.dumps(
            document
            | {"pedestrian_crossings": {str(i): crossing for i in range(10_000)}}
        ),
    }


def rings() -> dict[str, bytes]:
    """Returns maps whose areas are large or tangled."""
    document = argoverse2_files.map_document(WANTED)
    rng = np.random.default_rng(0)

    def area(*outlines: np.ndarray) -> bytes:
        members = {
            str(i): {"id": i, "area_boundary": files.records(outline)}
            for i, outline in enumerate(outlines)
        }
        return orjson.dumps(document | {"drivable_areas": members})

    def circle(number: int, turns: int = 1) -> np.ndarray:
        angle = np.linspace(0, 2 * np.pi * turns, number, endpoint=False)
        return 500 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def bars(number: int) -> list[np.ndarray]:
        corners = np.array([[0, 0], [0, 0.6], [900, 0.6], [900, 0.0]])
        return [corners + np.array([0, i]) for i in range(number)]

    comb = np.stack([np.arange(20_000) // 2 % 1000, np.arange(20_000) % 2 * 900], -1)
    crossed = [bar[:, ::-1] for bar in bars(30)]
    return {
        "a ring of too many points": area(circle(200_001)),
        "a large ring": area(circle(50_000)),
        "a ring that goes around often": area(circle(5000, turns=7)),
        "a star": area(circle(1001, turns=500)),
        "a tangle": area(rng.uniform(0, 900, (20_000, 2))),
        "a comb": area(comb),
        "a ring of one place": area(np.zeros((20_000, 2))),
        "a ring there and back": area(np.concatenate([comb[:900], comb[:900][::-1]])),
        "bars": area(*bars(900)),
        "bars across bars": area(*bars(30), *crossed),
        "an area many times": area(*[circle(12)] * 40),
        "specks": area(*(circle(3) / 500 + [i % 90, i // 90] for i in range(1000))),
        "no number": area(circle(20) * np.nan),
        "far apart": area(circle(20), circle(20) + 9e6),
    }
