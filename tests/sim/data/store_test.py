"""Tests that a store gives back what was put in, or says what is wrong with it."""

import dataclasses
import json
import pathlib
from collections.abc import Sequence

import msgpack
import numpy as np
import pytest

from drivetrain.sim.data import store
from drivetrain.sim.data.entry import entry_of
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.synthetic import generate as synthetic
from tests.sim.data import files, mutations

NUM_MUTATIONS = 200


def write_store(path: pathlib.Path, groups: Sequence[Sequence[Packed]]) -> None:
    """Writes a store with a shard for each group."""
    shards = []
    for number, group in enumerate(groups):
        shard = path / f"shard-{number:05d}.array_record"
        digest = store.write_shard(shard, group)
        found = [dataclasses.asdict(entry_of(one)) for one in group]
        listing = {"sha256": digest, "bad": [], "scenarios": found}
        store.write_json(shard.with_suffix(".json"), listing)
        shards.append({"name": shard.name, "sha256": digest})
    manifest = {"format_version": store.FORMAT_VERSION, "shards": shards}
    store.write_json(path / store.MANIFEST, manifest)


@pytest.fixture(scope="module", params=[True, False], ids=["quantised", "float32"])
def packed(request: pytest.FixtureRequest) -> list[Packed]:
    config = PackConfig(quantize=request.param)
    return [pack(synthetic.generate(seed), config) for seed in range(3)]


@pytest.fixture
def made(tmp_path: pathlib.Path, packed: list[Packed]) -> pathlib.Path:
    """Returns a store of two shards."""
    write_store(tmp_path, (packed[:2], packed[2:]))
    return tmp_path


def change_manifest(path: pathlib.Path, **changes: object) -> None:
    """Writes other values into the manifest of a store."""
    file = path / store.MANIFEST
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def dtypes(packed: Packed) -> list[str]:
    """Returns the dtype of each array of a packed scenario."""
    values = [getattr(packed, field.name) for field in dataclasses.fields(packed)]
    return [value.dtype.name for value in values if isinstance(value, np.ndarray)]


def test_decoding_undoes_encoding(packed):
    for scenario in packed:
        found = store.decode(store.encode(scenario))

        assert files.differences(found, scenario) == []
        assert dtypes(found) == dtypes(scenario)


def test_equal_scenarios_have_equal_bytes():
    first, second = (pack(synthetic.generate(7), PackConfig()) for _ in range(2))

    assert first is not second
    assert store.encode(first) == store.encode(second)


def test_the_order_of_an_array_in_memory_does_not_show_in_its_bytes(packed):
    scenario = packed[0]
    turned = dataclasses.replace(scenario, poses=np.asfortranarray(scenario.poses))

    assert store.encode(turned) == store.encode(scenario)


def test_a_store_yields_its_scenarios_in_order(made, packed):
    found = list(store.read(made))

    assert [store.encode(one) for one in found] == [store.encode(one) for one in packed]


def test_equal_shards_have_equal_bytes(made, packed):
    again = made / "again.array_record"

    digest = store.write_shard(again, packed[:2])

    assert again.read_bytes() == (made / "shard-00000.array_record").read_bytes()
    assert digest == store.file_digest(again)


@pytest.mark.parametrize(
    "record",
    [
        b"",
        b"\xc1",
        msgpack.packb([1, 2]),
        msgpack.packb({"scenario_id": "a"}),
        msgpack.packb({"another_field": 1}),
        msgpack.packb({"poses": ["object", [1], b"12345678"]}),
        msgpack.packb({"poses": ["int16", [3], b"12"]}),
        msgpack.packb({"poses": ["int16", "3", b"12"]}),
        msgpack.packb({"poses": [["int16"], [1], b"12"]}),
        msgpack.packb({"poses": [1, 2]}),
        msgpack.packb(None),
    ],
    ids=lambda record: repr(record)[:30],
)
def test_bytes_that_are_no_packed_scenario_are_said_to_be_none(record):
    with pytest.raises(store.StoreError, match=r"is no packed .*drivetrain prepare"):
        store.decode(record)


def test_damaged_bytes_give_a_scenario_or_a_sentence(packed):
    rng = np.random.default_rng(0)
    record = store.encode(packed[0])
    num_refused = 0
    for _ in range(NUM_MUTATIONS):
        try:
            store.decode(mutations.damaged(record, rng))
        except store.StoreError:
            num_refused += 1

    assert num_refused > NUM_MUTATIONS / 4


def test_a_record_of_another_version_names_the_field(packed):
    fields = msgpack.unpackb(store.encode(packed[0]))
    fields["colour"] = 1

    with pytest.raises(store.StoreError, match="colour"):
        store.decode(msgpack.packb(fields))


@pytest.mark.parametrize("raised", [RuntimeError, KeyboardInterrupt])
def test_a_shard_that_is_cut_leaves_nothing(tmp_path, packed, raised):
    def scenarios():
        yield packed[0]
        raise raised

    with pytest.raises(raised):
        store.write_shard(tmp_path / "shard-00000.array_record", scenarios())

    assert list(tmp_path.iterdir()) == []


def test_a_shard_that_is_cut_leaves_the_one_before_it(made, packed):
    shard = made / "shard-00000.array_record"
    before = shard.read_bytes()

    def scenarios():
        yield packed[0]
        raise RuntimeError

    with pytest.raises(RuntimeError):
        store.write_shard(shard, scenarios())

    assert shard.read_bytes() == before
    assert not list(made.glob("*.partial"))


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no store at .*none.*prepare"):
        list(store.read(tmp_path / "none"))


def test_an_unfinished_store_is_said_to_be_one(made):
    (made / store.MANIFEST).unlink()

    assert not store.is_store(made)
    with pytest.raises(FileNotFoundError, match=r"no finished store.*continues"):
        store.read_manifest(made)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"\xff\xfe",
        b"[]",
        b"null",
        b"{}",
        b'{"format_version": 1}',
        b'{"format_version": 1, "shards": 3}',
        b'{"format_version": 1, "shards": [3]}',
        b'{"format_version": 1, "shards": [{"name": 3}]}',
    ],
)
def test_a_damaged_manifest_is_said_to_be_damaged(made, text):
    (made / store.MANIFEST).write_bytes(text)

    with pytest.raises(store.StoreError, match=r"manifest.json.*prepare"):
        store.read_manifest(made)


def test_a_store_of_another_version_is_refused(made):
    change_manifest(made, format_version=99)

    reads = f"reads {store.FORMAT_VERSION}"
    with pytest.raises(store.StoreError, match=rf"format 99.*{reads}.*make it anew"):
        list(store.read(made))


def test_a_missing_shard_is_named(made):
    (made / "shard-00001.array_record").unlink()

    with pytest.raises(store.StoreError, match=r"shard-00001.* is missing"):
        list(store.read(made))


@pytest.mark.parametrize("keep", [0, 100, 0.5])
def test_a_shard_that_was_cut_off_is_named(made, keep):
    shard = made / "shard-00001.array_record"
    whole = shard.read_bytes()
    shard.write_bytes(whole[: int(keep if keep != 0.5 else len(whole) / 2)])

    with pytest.raises(store.StoreError, match="shard-00001"):
        list(store.read(made))


def test_flipped_bits_in_a_shard_are_noticed(made):
    shard = made / "shard-00001.array_record"
    whole = bytearray(shard.read_bytes())
    middle = whole.index(b"\x28\xb5\x2f\xfd") + 200  # inside the first zstd frame
    whole[middle] ^= 1
    shard.write_bytes(whole)

    with pytest.raises(store.StoreError, match="shard-00001"):
        list(store.read(made))


@pytest.fixture
def other(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Returns a store of other scenarios, of one shard of two."""
    path = tmp_path_factory.mktemp("other")
    scenarios = [pack(synthetic.generate(seed), PackConfig()) for seed in (7, 8)]
    write_store(path, [scenarios])
    return path


def test_a_shard_of_another_store_is_noticed_when_it_is_read(made, other):
    name = "shard-00000.array_record"
    (made / name).write_bytes((other / name).read_bytes())

    with pytest.raises(store.StoreError, match=f"'{name}' .* is not the one.*record 0"):
        list(store.read(made))
    with pytest.raises(store.StoreError, match=f"'{name}' .* is not the one"):
        store.verify(made)


def test_a_shard_with_another_number_of_records_is_noticed(made, other):
    shard = made / "shard-00001.array_record"
    shard.write_bytes((other / "shard-00000.array_record").read_bytes())

    with pytest.raises(store.StoreError, match="4 records, 3 in the lists"):
        store.Records(made)


def test_a_shard_of_another_store_with_its_list_is_noticed(made, other):
    for path in other.glob("shard-*"):
        (made / path.name).write_bytes(path.read_bytes())

    with pytest.raises(store.StoreError, match="is the list of another shard"):
        store.Records(made)


def test_a_whole_store_is_verified(made):
    store.verify(made)


@pytest.mark.parametrize(
    "trick", ["..", "", ".", "../{0}/{1}", "/etc/passwd", "a/../{1}"]
)
def test_a_manifest_names_no_file_outside_its_store(made, trick):
    name = trick.format(made.name, "shard-00000.array_record")
    change_manifest(made, shards=[{"name": name, "sha256": ""}])

    with pytest.raises(store.StoreError, match="missing"):
        store.shard_paths(made)
