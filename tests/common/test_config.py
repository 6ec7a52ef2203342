"""Parameters from file, --set and options, and what is said when they are wrong."""

from pathlib import Path

import pytest

from busybot.boards.config import BoardConfig
from busybot.common.config import asked, build
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.interact.training.config import TrainConfig


def test_later_sources_win(tmp_path: Path) -> None:
    file = tmp_path / "boards.yaml"
    file.write_text("boards: 5\nlamps: [3, 4]\nseed: 1\n")
    config = build(BoardConfig, file, ["seed=2", "lamps=[2, 3]"], {"seed": 3, "boards": None})
    assert (config.boards, config.lamps, config.seed) == (5, (2, 3), 3)


def test_what_is_asked_for_is_known_before_it_is_checked(tmp_path: Path) -> None:
    file = tmp_path / "train.yaml"
    file.write_text("variant: paper\n")
    assert asked("variant", None, [], {"variant": None}) is None
    assert asked("variant", file, [], {"variant": None}) == "paper"
    assert asked("variant", file, ["variant=fast"], {}) == "fast"
    assert asked("variant", file, ["variant=fast"], {"variant": "paper"}) == "paper"


@pytest.mark.parametrize("value", [".inf", "-.inf", ".nan"])
def test_what_json_has_no_number_for_is_refused(value: str) -> None:
    with pytest.raises(BusybotError, match=r"position\.learning_rate"):
        build(TrainConfig, None, [f"position.learning_rate={value}"], {})


def test_another_default_yields_to_file_and_setting_within_its_group(tmp_path: Path) -> None:
    usual = {"direction.augmentation.transposed": 0.0}
    file = tmp_path / "train.yaml"
    file.write_text("direction: {batch: 8, augmentation: {log_height: 0.1}}\n")
    kept = build(TrainConfig, file, [], {}, usual).direction
    assert (kept.batch, kept.augmentation.log_height, kept.augmentation.transposed) == (8, 0.1, 0.0)
    file.write_text("direction: {augmentation: {transposed: 0.2}}\n")
    assert build(TrainConfig, file, [], {}, usual).direction.augmentation.transposed == 0.2
    setting = ["direction.augmentation.transposed=0.3"]
    assert build(TrainConfig, file, setting, {}, usual).direction.augmentation.transposed == 0.3
    file.write_text("direction: 3\n")
    with pytest.raises(BusybotError, match="parameter direction"):
        build(TrainConfig, file, [], {}, usual)


@pytest.mark.parametrize(
    ("text", "settings", "message"),
    [
        ("boards: [1", [], "not valid YAML"),
        ("- 1", [], "not a mapping"),
        ("bords: 5", [], "parameter bords"),
        ("boards: 0", [], "parameter boards"),
        ("boards: 5", ["lamps"], "name=value"),
        ("boards: 5", ["boards.x=1"], "boards is a value"),
        ("boards: !!python/object/apply:os.system ['true']", [], "not valid YAML"),
        ("boards: 5", ["boards=!!int ''"], "not of the kind that its tag names"),
    ],
)
def test_faults_are_named(tmp_path: Path, text: str, settings: list[str], message: str) -> None:
    file = tmp_path / "boards.yaml"
    file.write_text(text)
    with pytest.raises(BusybotError, match=message):
        build(BoardConfig, file, settings, {})


class Inner(FrozenModel):
    often: int = 50
    patience: int = 10


class Group(FrozenModel):
    inner: Inner = Inner()
    width: int = 1


class Outer(FrozenModel):
    group: Group = Group(inner=Inner(often=100, patience=15), width=2)


def test_one_value_of_a_group_leaves_the_others_as_they_are_by_default(tmp_path: Path) -> None:
    """Not as they are by default in groups elsewhere."""
    assert build(Outer, None, ["group.inner.often=7"], {}) == Outer(
        group=Group(inner=Inner(often=7, patience=15), width=2)
    )
    assert build(Outer, None, ["group.width=3"], {}) == Outer(group=Group(inner=Inner(often=100, patience=15), width=3))
    (tmp_path / "c.yaml").write_text("group: {inner: {patience: 1}}")
    told = build(Outer, tmp_path / "c.yaml", ["group.width=4"], {})
    assert told == Outer(group=Group(inner=Inner(often=100, patience=1), width=4))


def test_a_parameter_that_is_called_as_its_group_is_told_from_it() -> None:
    class Inner(FrozenModel):
        camera: int = 1

    class Outer(FrozenModel):
        camera: Inner = Inner()

    with pytest.raises(BusybotError, match=r"parameter camera\.camera") as error:
        build(Outer, None, ["camera.camera=x"], {})
    assert error.value.hint == "the default is 1"


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match=r"nowhere\.yaml"):
        build(BoardConfig, tmp_path / "nowhere.yaml", [], {})


@pytest.mark.parametrize(
    "text", ["[" * 20_000, "a: " + "{b: " * 5_000, "- " * 5_000 + "x", "x: &a [1]\ny: *a\n", "1" * 9_000]
)
def test_yaml_that_would_take_long_is_refused_at_once(text: str, tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(text)
    with pytest.raises(BusybotError, match="config.yaml"):
        build(BoardConfig, file, [], {})
    with pytest.raises(BusybotError):
        build(BoardConfig, None, [f"boards={text}"], {})


@pytest.mark.parametrize("value", ["!!bool perhaps", "!!timestamp soon", "!!int ''", "!!float ''"])
def test_a_value_that_its_tag_does_not_fit_is_refused(value: str, tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(f"boards: {value}\n")
    with pytest.raises(BusybotError, match="config.yaml: not valid YAML"):
        build(BoardConfig, file, [], {})
    with pytest.raises(BusybotError, match="--set boards="):
        build(BoardConfig, None, [f"boards={value}"], {})


@pytest.mark.parametrize(
    ("settings", "options", "what", "hint"),
    [
        ([], {"split": "novel"}, "--split 'novel' is none of its values", "'novel-config'"),
        (["lamps=many"], {}, "parameter lamps: Input should be a valid tuple (given: 'many')", "the default is [3, 5]"),
        (["lamp=3"], {}, "parameter lamp: Extra inputs are not permitted", "did you mean lamps?"),
    ],
)
def test_a_refused_value_names_its_option_and_what_may_stand_there(
    settings: list[str], options: dict[str, str], what: str, hint: str
) -> None:
    with pytest.raises(BusybotError) as caught:
        build(BoardConfig, None, settings, options)
    assert what in caught.value.what
    assert hint in (caught.value.hint or "")
