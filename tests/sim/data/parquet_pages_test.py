"""Tests of the sums over the pages of parquet files."""

import io

import numpy as np
import pytest
from pyarrow import parquet as writer

from drivetrain.sim.data import parquet_pages
from drivetrain.sim.scenario import ScenarioError
from tests.sim.data.parquet_test import encoded


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd"])
def test_pages_unfold_to_what_the_footer_tells(version: str, compression: str) -> None:
    rng = np.random.default_rng(0)
    table = {"x": rng.random(5000), "t": [str(i % 7) for i in range(5000)]}
    record = encoded(
        table,
        compression=compression,
        data_page_version=version,
        data_page_size=8192,
        row_group_size=2000,
    )
    metadata = writer.read_metadata(io.BytesIO(record))
    told = sum(metadata.row_group(i).total_byte_size for i in range(3))
    found = parquet_pages.unfolded_bytes(record, limit=told)
    # The footer counts the heads of pages too: less than a tenth of pages of 8 kB.
    assert 0.9 * told < found < told


@pytest.mark.parametrize(
    "footer", [b"", b"\x00", b"\x19" * 50, b"\x1c" * 500, b"\xff" * 50]
)
def test_a_footer_that_is_none_is_named(footer: bytes) -> None:
    record = b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1"
    with pytest.raises(ScenarioError, match="the parquet data are damaged"):
        parquet_pages.unfolded_bytes(record, 10**6)
