"""Lists the formats that have readers: how tests write, damage and attack them.

A new reader needs one entry in `FORMATS`, by its name.
"""

import dataclasses
import gzip
import pathlib
import pickle
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import orjson

from drivetrain.sim.data import parts
from drivetrain.sim.scenario import MapType, Polylines, Scenario
from tests.sim.data import (
    argoverse2_attacks,
    argoverse2_files,
    commonroad_attacks,
    commonroad_files,
    files,
    malice,
    mutations,
    pickles,
    protos,
    puffer,
)

LOG = "log"  # the name of a file of a format that is one file
ZEROS = gzip.compress(bytes(1 << 20), mtime=0) * 200  # more than a record may have
DEEP = 1 << 20  # containers in one another

Files = dict[str, bytes]  # by name, within a folder
Attacks = dict[str, Files]  # by label: files to be put in the place of others


def _same(value: Any) -> Any:
    return value


def _no_attacks() -> Attacks:
    return {}


def in_place_of(name: str, attacks: Files) -> Attacks:
    """Returns attacks that are each one file of a name."""
    return {label: {name: content} for label, content in attacks.items()}


def on_log(attacks: Callable[[], Files]) -> Callable[[], Attacks]:
    """Returns what makes attacks on formats that are one file."""
    return lambda: in_place_of(LOG, attacks())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Format:
    """How tests write one format.

    `write` makes the files of a scenario as damage may find them; `seal` then adds to
    each what tells damage (a checksum), and `target` is what is handed to the reader
    ("" for the folder). Where files hold documents, `document` and `dump` make them by
    way of one, which may be damaged too. `attacks` are files made to hurt; `attacked`
    is the file by which the format is told. `carried` leaves of a scenario what the
    format can say, and `compared` what of a scenario read is as it was written.
    """

    write: Callable[[Scenario], Files]
    carried: Callable[[Scenario], Scenario]
    seal: Callable[[bytes], bytes] = _same
    target: str = LOG
    compared: Callable[[Scenario], Scenario] = _same
    document: Callable[[Scenario], Any] | None = None
    dump: Callable[[Any], Files] = _same
    absurd: tuple[Any, ...] = mutations.ABSURD
    attacks: Callable[[], Attacks] = _no_attacks
    attacked: str = LOG

    def sealed(self, contents: Files) -> Files:
        """Returns files as a reader is to find them."""
        return {name: self.seal(content) for name, content in contents.items()}

    def put(self, folder: pathlib.Path, contents: Files) -> pathlib.Path:
        """Writes sealed files into a folder and returns what to read."""
        for name, content in contents.items():
            (folder / name).write_bytes(content)
        return folder / self.target


def one_file(encode: Callable[[Any], bytes]) -> Callable[[Any], Files]:
    """Returns what writes a scenario or document as the only file of its format."""
    return lambda wanted: {LOG: encode(wanted)}


def example_record(wanted: Scenario) -> bytes:
    """Encodes a scenario as a tf.Example."""
    return protos.example_proto(wanted.scenario_id, protos.example_features(wanted))


def json_file(document: Any) -> bytes:
    """Encodes a document as JSON, of which absurd values may be none."""
    return orjson.dumps(document, default=str)


def without_links(wanted: Scenario) -> Scenario:
    """Leaves out what only lane graphs say."""
    return dataclasses.replace(wanted, lane_links=None)


def with_known_links(wanted: Scenario) -> Scenario:
    """Leaves out links to lanes that there are not."""
    assert wanted.lane_links is not None
    successor = wanted.lane_links.successor
    known = np.isin(successor, wanted.roads.feature_id).all(axis=1)
    links = dataclasses.replace(wanted.lane_links, successor=successor[known])
    return dataclasses.replace(wanted, lane_links=links)


def of_pufferdrive(wanted: Scenario) -> Scenario:
    """Leaves no lights, links, marks, id and of map types the kind alone."""
    tracks, kinds = wanted.tracks, wanted.roads.map_type
    plain = np.select(
        [kinds <= MapType.LANE_BIKE, kinds < MapType.EDGE_UNKNOWN],
        [MapType.LANE_UNDEFINED, MapType.LINE_UNKNOWN],
        np.where(kinds < MapType.STOP_SIGN, MapType.EDGE_BOUNDARY, kinds),
    )
    return dataclasses.replace(
        without_links(wanted),
        scenario_id=LOG,
        ego_source="last",
        tracks=dataclasses.replace(
            tracks, is_of_interest=np.zeros_like(tracks.is_of_interest)
        ),
        roads=dataclasses.replace(wanted.roads, map_type=plain),
        lights=parts.no_lights(wanted.num_steps),
    )


def attacks_on_scenarionet() -> Files:
    """Returns pickles that are malicious, or unfold to gigabytes in some part."""
    wanted = files.scenario(num_steps=13)
    rows = [[0.5] * 20_000] * 20_000
    long, array = [None] * 200_000, np.zeros((1 << 20, 3), np.int8)
    documents = {name: pickles.document(wanted) for name in "abcdefg"}
    lane, light = {"type": "LANE_FREEWAY"}, {"stop_point": [1.0, 2.0, 3.0]}
    documents["a"]["map_features"]["11"]["polyline"] = rows
    documents["b"]["map_features"]["11"]["exit_lanes"] = rows
    shared = {str(i): lane | {"polyline": array} for i in range(5000)}
    documents["c"]["map_features"] |= shared
    state = documents["d"]["tracks"].popitem()[1]
    for name, width in (("position", 3), ("velocity", 2), ("heading", 1)):
        state["state"][name] = np.zeros((1 << 14, width), np.float16)
    for name in ("valid", "length", "width", "height"):
        state["state"][name] = np.ones(1 << 14, bool)
    documents["d"]["tracks"] = {str(i): state for i in range(1000)}
    shown = light | {"state": {"object_state": long}}
    documents["e"]["dynamic_map_states"] = {str(i): shown for i in range(5000)}
    documents["f"]["metadata"]["ts"] = rows
    documents["g"]["metadata"]["objects_of_interest"] = rows
    return malice.everything() | {
        f"unfolded {name}": pickle.dumps(content) for name, content in documents.items()
    }


def attacks_on_json() -> Files:
    """Returns JSON of many containers, and of numbers that are none."""
    deep = {f"deep {o.decode()}": o * DEEP for o in (b"[", b'{"a":')}
    within = {
        f"{name} as objects": b'{"roads": [1], "objects": [' + text
        for name, text in deep.items()
    }
    closed = b'{"roads": [1], "objects": ' + b"[" * DEEP + b"]" * DEEP + b"}"
    return within | {
        "closed": closed,
        "an integer": b'{"roads": [1], "objects": [' + b"9" * DEEP + b"]}",
        **{
            f"many {value.decode()}": b'{"roads": [1], "objects": ['
            + (value + b",") * (count << 20)
            + b"1]}"
            for value, count in (
                (b"null", 1),
                (b"{}", 40),
                (b"1.5", 30),
                (b'{"a":7}', 1),
            )
        },
        "zeros": gzip.compress(b"{", mtime=0) + ZEROS,
    }


def attacks_on_tfrecords() -> Files:
    """Returns TFRecords whose lengths lie, with checksums that do not."""

    def claiming(length: int, payload: bytes = b"") -> bytes:
        header = struct.pack("<Q", length)
        return header + files.checksum(header) + payload

    def filled(unit: bytes) -> bytes:
        return unit * ((15 << 20) // len(unit))

    whole = protos.scenario_proto(files.scenario(num_steps=13))
    lane = protos.field(3, filled(protos.field(8, b"")))
    integers = protos.field(2, protos.field(3, protos.field(1, filled(b"\x01"))))
    numbered = protos.field(1, protos.field(1, b"state/id") + integers)
    named = protos.field(1, protos.field(1, b"scenario/id") + protos.field(2, b""))
    nested = b""
    for _ in range(2000):
        nested = protos.field(1, nested)
    return {
        "an enormous length": claiming(2**63, b"x"),
        "the largest length": claiming(1 << 27, b"x"),
        "no payload": claiming(0),
        "many without payload": files.tfrecord(b"") * 10_000,
        "deep": files.tfrecord(nested),
        "empty tracks": files.tfrecord(whole + filled(protos.field(2, b""))),
        "empty states": files.tfrecord(
            whole + protos.field(2, filled(protos.field(3, b"")))
        ),
        "empty features": files.tfrecord(whole + filled(protos.field(8, b""))),
        "empty points": files.tfrecord(whole + protos.field(8, lane)),
        "empty entries": files.tfrecord(protos.field(1, filled(protos.field(1, b"")))),
        "many integers": files.tfrecord(protos.field(1, named + numbered)),
        "groups": files.tfrecord(b"\x0b" * 100_000),
        "endless varints": files.tfrecord(b"\x0a" + b"\xff" * 100_000),
        "zeros": gzip.compress(claiming(1 << 27), mtime=0) + ZEROS,
    }


def of_argoverse2(wanted: Scenario) -> Scenario:
    """Leaves tracks in the plane: heights and sizes are guessed, lanes made anew."""
    tracks = wanted.tracks
    return without_map(
        dataclasses.replace(
            wanted,
            tracks=dataclasses.replace(
                tracks, xyz=tracks.xyz * [1, 1, 0], size=tracks.size * 0
            ),
            lights=parts.no_lights(wanted.num_steps),
        )
    )


def of_commonroad(wanted: Scenario) -> Scenario:
    """Leaves tracks and lights: heights of objects are guessed, lanes made anew."""
    flat = dataclasses.replace(wanted.tracks, size=wanted.tracks.size * [1, 1, 0])
    return without_map(dataclasses.replace(wanted, tracks=flat))


def without_map(wanted: Scenario) -> Scenario:
    """Leaves out the roads and what ties them."""
    nothing = np.zeros(0, np.int64)
    roads = Polylines(
        xyz=np.zeros((0, 3)),
        offset=np.zeros(1, np.int64),
        map_type=nothing,
        feature_id=nothing,
    )
    return dataclasses.replace(without_links(wanted), roads=roads)


def attacks_on_argoverse2() -> Attacks:
    """Returns tables that hurt, and maps beside a table that does not."""
    map_name = argoverse2_files.map_name(argoverse2_attacks.WANTED)
    on_tables = in_place_of(LOG, argoverse2_attacks.tables())
    return on_tables | in_place_of(map_name, argoverse2_attacks.maps())


def attacks_on_pufferdrive() -> Files:
    """Returns maps whose counts lie, or are as large as they may be."""
    title = struct.pack("<iii", 1, 7, 91)
    road = struct.pack("<iii", 4, 7, 0) + puffer.NO_VALUES
    single = struct.pack("<iii", 1, 7, 1) + bytes(32) + puffer.NO_VALUES
    return {
        "objects without end": struct.pack("<ii", 10_000, 100_000) + title,
        "steps without end": struct.pack("<ii", 1, 1)
        + struct.pack("<iii", 1, 7, 10_000),
        "overflowing steps": struct.pack("<ii", 2, 1)
        + struct.pack("<iii", 1, 7, 1)
        + bytes(32 + 28)
        + struct.pack("<iii", 1, 7, 2**27),
        "many roads": struct.pack("<ii", 1, 50_000) + single + road * 50_000,
        "many objects": struct.pack("<ii", 10_000, 1) + single * 10_000 + road,
    }


FORMATS: dict[str, Format] = {
    "womd_example": Format(
        write=one_file(example_record),
        carried=without_links,
        seal=files.tfrecord,
        attacks=on_log(attacks_on_tfrecords),
    ),
    "womd_scenario": Format(
        write=one_file(protos.scenario_proto),
        carried=_same,
        seal=files.tfrecord,
        attacks=on_log(attacks_on_tfrecords),
    ),
    "womd_json": Format(
        write=one_file(lambda wanted: json_file(files.json_document(wanted))),
        carried=without_links,
        document=files.json_document,
        dump=one_file(json_file),
        attacks=on_log(attacks_on_json),
    ),
    "scenarionet": Format(
        write=one_file(pickles.scenarionet_file),
        carried=with_known_links,
        document=pickles.document,
        dump=one_file(pickle.dumps),
        absurd=mutations.ABSURD + mutations.ABSURD_ARRAYS,
        attacks=on_log(attacks_on_scenarionet),
    ),
    "pufferdrive": Format(
        write=one_file(puffer.puffer_file),
        carried=of_pufferdrive,
        attacks=on_log(attacks_on_pufferdrive),
    ),
    "argoverse2": Format(
        write=argoverse2_files.contents,
        carried=argoverse2_files.as_told,
        compared=of_argoverse2,
        document=argoverse2_files.document,
        dump=argoverse2_files.dump,
        attacks=attacks_on_argoverse2,
    ),
    "commonroad": Format(
        write=one_file(commonroad_files.text),
        carried=commonroad_files.as_told,
        compared=of_commonroad,
        # Of the older version: either is damaged as often.
        document=lambda wanted: commonroad_files.as_lists(
            commonroad_files.document(wanted, "2018b")
        ),
        dump=one_file(commonroad_files.markup),
        attacks=on_log(commonroad_attacks.everything),
    ),
}
