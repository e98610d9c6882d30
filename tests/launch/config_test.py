"""Tests that a config says what its file and the command line say, or why it cannot."""

import dataclasses
import pathlib
from typing import Literal

import pytest
from hypothesis import given, strategies as st

from drivetrain.launch import config
from drivetrain.launch.entries import ConfigError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dqn:
    """A learner of one kind."""

    name: Literal["dqn"] = "dqn"
    learning_rate: float = 5e-5
    hidden: tuple[int, ...] = (128, 128)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ppo:
    """A learner of another kind."""

    name: Literal["ppo"] = "ppo"
    clip: float = 0.1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Env:
    """A section with a check of its own."""

    num_objects: int = 128
    dynamics: Literal["delta", "bicycle"] = "bicycle"
    window: tuple[float, float] = (80.0, 2.1)

    def __post_init__(self) -> None:
        if self.num_objects < 1:
            raise ValueError(f"num_objects must be at least 1, got {self.num_objects}.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Root:
    """One field of every type that a config can have."""

    data: str
    seed: int | None = None
    resume: bool = False
    limit: float | Literal["none"] = "none"
    folder: pathlib.Path = pathlib.Path("runs")
    env: Env = Env()
    other_env: Env | None = None
    learner: Dqn | Ppo = Dqn()
    rewards: dict[str, float] = dataclasses.field(default_factory=dict)


NUMBERS = st.floats(allow_nan=False)
WHOLE = st.integers(-(10**12), 10**12)
TEXT = st.text(st.characters(codec="utf-8"))
ENVS = st.builds(
    Env,
    num_objects=st.integers(1, 10**9),
    dynamics=st.sampled_from(["delta", "bicycle"]),
    window=st.tuples(NUMBERS, NUMBERS),
)
ROOTS = st.builds(
    Root,
    data=TEXT,
    seed=st.none() | WHOLE,
    resume=st.booleans(),
    limit=NUMBERS | st.just("none"),
    folder=st.sampled_from([pathlib.Path("a b"), pathlib.Path("1e3"), pathlib.Path()]),
    env=ENVS,
    other_env=st.none() | ENVS,
    learner=st.builds(
        Dqn, learning_rate=NUMBERS, hidden=st.lists(WHOLE, max_size=3).map(tuple)
    )
    | st.builds(Ppo, clip=NUMBERS),
    rewards=st.dictionaries(TEXT, NUMBERS, max_size=3),
)


@given(ROOTS)
def test_a_config_survives_being_written_and_read(root: Root) -> None:
    assert config.from_yaml(config.to_yaml(root), Root) == root


def test_sections_lists_and_numbers_read_by_the_type_of_their_field() -> None:
    text = """
    data: 2026-11-21
    seed: 3e7
    env: {num_objects: 1_000, window: [1, 2e-1]}
    learner:
      name: dqn
      learning_rate: 1e-3
      hidden: [256]
    rewards:
      collision: -1
    """
    assert config.from_yaml(text, Root) == Root(
        data="2026-11-21",
        seed=30_000_000,
        env=Env(num_objects=1000, window=(1.0, 0.2)),
        learner=Dqn(learning_rate=0.001, hidden=(256,)),
        rewards={"collision": -1.0},
    )


def test_the_command_line_wins_over_the_file(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "dqn.yaml"
    path.write_text("data: womd\nlearner: {name: dqn, learning_rate: 1}\nseed: 3\n")
    overrides = (
        "data=*.tfrecord",
        "learner.learning_rate=3e-5",
        "learner.hidden=[8, 8]",
        "seed=null",
        "env.num_objects=4",
        "other_env.num_objects=5",
    )
    assert config.load(path, Root, overrides) == Root(
        data="*.tfrecord",
        learner=Dqn(learning_rate=3e-5, hidden=(8, 8)),
        env=Env(num_objects=4),
        other_env=Env(num_objects=5),
    )


def test_a_value_keeps_its_equals_signs() -> None:
    assert config.from_yaml("data: x", Root, ["data=a=b"]).data == "a=b"


def test_the_tag_of_a_section_chooses_its_type() -> None:
    root = config.from_yaml("data: x", Root, ["learner.name=ppo"])
    assert root.learner == Ppo()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("data: x\nlerner:\n  clip: 1", "x.yaml:3: unknown key 'lerner'; did you mean"),
        ("data: x\nzzz: 1", "unknown key 'zzz'. Known here: data, seed, resume"),
        ("data: x\nnum_objects: 1", "did you mean 'env.num_objects'?"),
        (
            "data: x\nenv:\n  num_object: 1",
            "x.yaml:3: unknown key 'env.num_object'; did",
        ),
        (
            "data: x\nseed: 1.5",
            "x.yaml:2: seed must be a whole number or null; got '1.5'",
        ),
        ("data: x\nseed: '1'", "got the text '1'"),
        ("data: x\nresume: yes", "resume must be true or false; got 'yes'"),
        ("data: x\nresume: 1", "resume must be true or false; got '1'"),
        ("data: x\nenv: {num_objects: no}", "env.num_objects must be a whole number"),
        (
            "data: x\nenv: {num_objects: }",
            "env.num_objects must be a whole number; got n",
        ),
        (
            "data: x\nenv: {num_objects: 0}",
            "env: num_objects must be at least 1, got 0.",
        ),
        (
            "data: x\nenv: {dynamics: bicicle}",
            "delta, bicycle; got 'bicicle'; did you me",
        ),
        (
            "data: x\nenv: {window: [1]}",
            "env.window must be a list of 2 in brackets; got 1",
        ),
        ("data: x\nenv: {window: [1, a]}", "env.window[1] must be a number; got 'a'"),
        (
            "data: x\nenv: {window: [1, nan]}",
            "env.window[1] must be a number; got 'nan'",
        ),
        (
            "data: x\nenv: 3",
            "env is a section with the keys num_objects, dynamics, window",
        ),
        (
            "data: x\nlearner: {name: dqm}",
            "learner.name must be one of dqn, ppo; got 'dqm'",
        ),
        ("data: x\nlearner: {clip: 1}", "no value for learner.name"),
        ("data: x\nlimit: much", "limit must be a number or one of none; got 'much'"),
        ("data: x\nrewards: 1", "rewards must be a section; got '1'"),
        ("data: [x]", "data must be text; got a list"),
        ("seed: 1", "no value for data, which has no default"),
        (
            "data: x\nseed: 1\ndata: y",
            "x.yaml:3: 'data' is given twice, first at x.yaml:1",
        ),
        ("", "x.yaml is empty"),
        ("# only a comment", "x.yaml is empty"),
        ("just words", "x.yaml holds 'just words'; expected lines of `key: value`"),
        ("data: [", "x.yaml is no valid YAML"),
        ("a: 1\n---\nb: 2", "x.yaml is no valid YAML"),
        ("data: &a [*a]", "spell the alias out"),
        ("data: !!python/object/apply:os.getcwd []", "x.yaml:1: a config holds plain"),
    ],
)
def test_a_mistake_in_a_file_is_named_with_its_place(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        config.from_yaml(text, Root, source="x.yaml")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("seed", "the command line: 'seed' sets nothing; write field=value"),
        ("sede=1", "the command line: unknown key 'sede'; did you mean 'seed'?"),
        ("learner.clip=1", "the command line: unknown key 'learner.clip'"),
        ("learner.hidden=[1", "the command line is no valid YAML"),
        ("learner.hidden=1", "learner.hidden must be a list in brackets, each a whole"),
        (
            "seed.x=1",
            "the command line: seed must be a whole number or null; got a sec",
        ),
    ],
)
def test_a_mistake_on_the_command_line_is_named(word: str, message: str) -> None:
    text = "data: x\nlearner: {name: dqn}"
    with pytest.raises(ConfigError) as caught:
        config.from_yaml(text, Root, [word])
    assert message in str(caught.value)


def test_a_missing_file_offers_its_neighbour(tmp_path: pathlib.Path) -> None:
    (tmp_path / "dqn.yaml").write_text("data: x")
    with pytest.raises(FileNotFoundError, match=r"did you mean '.*dqn\.yaml'"):
        config.load(tmp_path / "dqn", Root)


def test_a_folder_is_told_from_a_missing_file(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match="is a folder; name a config file in it"):
        config.load(tmp_path, Root)


@pytest.mark.parametrize(
    ("words", "where"), [((), "run.yaml:3"), (("env.num_objects=0",), "the command")]
)
def test_a_value_out_of_range_is_told_by_where_it_stands(
    words: tuple[str, ...], where: str
) -> None:
    text = f"data: x\nenv:\n  num_objects: {4 if words else 0}\n"
    with pytest.raises(ConfigError, match=f"^{where}.*: env: num_objects must be"):
        config.from_yaml(text, Root, words, source="run.yaml")


def test_text_in_another_encoding_is_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes("data: é".encode("latin-1"))
    with pytest.raises(ConfigError, match="no text in UTF-8"):
        config.load(path, Root)


def test_configs_differ_in_the_fields_that_differ() -> None:
    before = Root(data="a b", seed=0, learner=Dqn(hidden=(4, 8)))
    now = Root(data="a b", env=Env(num_objects=3), learner=Ppo(clip=0.2))
    assert config.differences(before, now) == [
        "seed (0, now null)",
        "env.num_objects (128, now 3)",
        "learner.name (dqn, now ppo)",
        "learner.learning_rate (5.0e-05, now nothing)",
        "learner.hidden ([4, 8], now nothing)",
        "learner.clip (nothing, now 0.2)",
    ]


@given(ROOTS)
def test_a_config_differs_in_nothing_from_itself(root: Root) -> None:
    assert config.differences(root, dataclasses.replace(root)) == []
