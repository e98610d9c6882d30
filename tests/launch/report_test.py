"""Tests that a report holds what it was given, safely and in one file."""

import html.parser
import json
import pathlib
import re

import numpy as np
import pytest

from drivetrain.launch import report, tables

ATTACK = "<script>alert('x')</script>\" onload=\"y"
PNG = b"\x89PNG\r\n\x1a\n"


class Page(html.parser.HTMLParser):
    """What a browser makes of a page: its tags, their attributes and its text."""

    def __init__(self, page: str) -> None:
        """Reads the page."""
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keeps a tag."""
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        """Keeps a piece of text."""
        self.text += data


@pytest.fixture
def page() -> Page:
    """A report whose every text tries to be markup."""
    episodes = {"collision": np.array([True, False])}
    return Page(
        report.render(
            report.Report(
                title=f"title {ATTACK}",
                summary=f"summary {ATTACK}",
                rows=[
                    tables.summarize(
                        episodes, agent=f"a {ATTACK}", sim_agent=f"s {ATTACK}", seed=0
                    )
                ],
                curves=[
                    report.Curve(
                        label="loss & <more>", steps=[0, 1], values=[1.0, None]
                    )
                ],
                pictures=[report.Picture(png=PNG, caption=f"scenario {ATTACK}")],
                config=f"data: {ATTACK}",
                facts={f"fact {ATTACK}": f"value {ATTACK}"},
            )
        )
    )


def test_nothing_that_is_inserted_acts_as_markup(page: Page) -> None:
    assert "script" not in {tag for tag, _ in page.tags}
    names = {name for _, attributes in page.tags for name in attributes}
    assert not {name for name in names if name.startswith("on")}


@pytest.mark.parametrize(
    "part", ["title", "summary", "a", "s", "scenario", "data:", "fact", "value"]
)
def test_what_is_inserted_is_shown_as_it_is(page: Page, part: str) -> None:
    assert f"{part} {ATTACK}" in page.text


def test_the_page_needs_no_other_file(page: Page) -> None:
    sources = [attrs["src"] for _, attrs in page.tags if "src" in attrs]
    assert len(sources) == 2
    assert all(source.startswith("data:image/") for source in sources if source)
    assert not {"link", "iframe", "object"} & {tag for tag, _ in page.tags}
    assert not re.search(r"url\(|@import|https?:", page.text)


def test_the_table_shows_the_rate_and_its_interval(page: Page) -> None:
    assert "50.00" in page.text
    assert "0.0\N{EN DASH}100" in page.text


def test_parts_without_content_are_left_out() -> None:
    page = Page(report.render(report.Report(title="t", summary="s")))
    assert not {"h2", "table", "img", "pre"} & {tag for tag, _ in page.tags}


def test_the_same_report_is_the_same_file(tmp_path: pathlib.Path) -> None:
    made = report.Report(
        title="t",
        summary="s",
        curves=[report.Curve(label="loss", steps=[0, 1], values=[1.0, 2.0])],
    )
    for name in ("a.html", "b.html"):
        report.write(tmp_path / name, made)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_the_environment_names_device_versions_and_command() -> None:
    facts = report.environment()
    assert {*facts} == {"Command", "Device", "Versions"}
    assert "jax" in facts["Versions"]
    assert "(cpu)" in facts["Device"] or "(gpu)" in facts["Device"]
    assert json.dumps(facts)
