"""`busybot generate` and `busybot collect` as a user types them."""

import json
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import pytest

from busybot.common.atomic_io import LOCK_FILE
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.mcap.reader import read_episode
from busybot.sim.scene.real_camera import REAL
from tests.cli.commands import busybot
from tests.cli.killing import kill_once

pytestmark = pytest.mark.usefixtures("in_process")

SMALL = ("--set", "render.width=160", "--set", "render.height=120", "--steps", "3")


def test_from_nothing_to_episodes(tmp_path: Path) -> None:
    out = str(tmp_path / "data")
    made = busybot("generate", out, "--boards", "3", "--group-size", "1", "--seed", "5", "--json")
    assert made.returncode == 0, made.stderr
    told = json.loads(made.stdout)
    assert told["boards"] == 3 and told["seed"] == 5 and len(told["board_hash"]) == 64
    collected = busybot("collect", out, "--policy", "scripted", "--workers", "1", *SMALL, "--json")
    assert collected.returncode == 0, collected.stderr
    assert json.loads(collected.stdout)["episodes"] == 3
    info = json.loads(busybot("dataset", "info", out, "--json").stdout)
    assert (info["boards"], info["episodes"], info["steps"]) == (3, 3, 9)
    assert info["board_hash"] == told["board_hash"]
    again = busybot("collect", out, "--policy", "random", *SMALL)
    assert again.returncode == 1
    assert "policy 'scripted', now 'random'" in again.stderr and "hint:" in again.stderr


def test_generate_says_whose_objects_stand_on_the_boards(tmp_path: Path, few_objects: Callable[[int], Path]) -> None:
    ours = busybot("generate", str(tmp_path / "ours"), "--boards", "1").stderr
    folder = few_objects(0)
    theirs = busybot("generate", str(tmp_path / "theirs"), "--boards", "1", "--assets", str(folder)).stderr
    assert "of procedural objects" in ours and f"of objects from {folder.name}" in theirs


def test_the_real_camera_is_asked_for_by_name_and_its_terms_by_theirs(tmp_path: Path) -> None:
    out = str(tmp_path / "data")
    busybot("generate", out, "--boards", "1")
    unknown = busybot("collect", out, "--camera", "best")
    assert unknown.returncode == 2 and "'best' is not one of" in unknown.stderr
    wrong = busybot("collect", out, "--camera", "real", "--set", "render.camera.hand=2")
    assert wrong.returncode == 2 and "render.camera.hand" in wrong.stderr
    few = ("--policy", "random", "--workers", "1", *SMALL)
    terms = ("--set", "render.camera.noise=0.02", "--set", "render.camera.blur=0", "--set", "render.randomise.fov=0.1")
    done = busybot("collect", out, "--camera", "real", *terms, *few)
    assert done.returncode == 0, done.stderr
    dataset = Dataset.open(Path(out))
    assert dataset.info.collect is not None
    render = dataset.info.collect.settings["render"]
    assert render["camera"] == {**{term: value for term, value in REAL.items() if term != "blur"}, "noise": 0.02}
    assert render["randomise"] == {"fov": 0.1}
    assert len(read_episode(dataset.episode_path(0)).images) == 4
    dataset.episode_path(0).unlink()
    again = shlex.split(collect_command(Path(out), dataset.info))
    assert busybot(*again[1:], "--workers", "1", *SMALL[:4]).returncode == 0
    both = busybot("collect", out, "--camera", "clean", "--set", "render.camera.noise=0.05", *few)
    assert both.returncode == 2 and "is no clean camera" in both.stderr
    refused = busybot("collect", out, "--camera", "clean", *few)
    assert refused.returncode == 1 and "render" in refused.stderr


def test_the_hint_for_other_settings_is_a_command_that_goes_on(tmp_path: Path) -> None:
    out = str(tmp_path / "data")
    busybot("generate", out, "--boards", "2", "--group-size", "1")
    sets = ("interaction.increments=5", "interaction.strict_angle_deg=40", "learned.collect=0.01", "learned.prior=0.2")
    own = ("--policy", "learned", *(word for one in sets for word in ("--set", one)))
    done = busybot("collect", out, "--workers", "1", *own, *SMALL[:4], "--steps", "1")
    assert done.returncode == 0, done.stderr
    Dataset.open(Path(out)).episode_path(1).unlink()
    refused = busybot("collect", out, "--policy", "learned", "--steps", "1")
    assert refused.returncode == 1 and "begun with other settings" in refused.stderr
    hint = refused.stderr.split("hint: ")[1].split("; or collect into another dataset")[0]
    words = shlex.split(" ".join(hint.split()))
    assert words[:2] == ["busybot", "collect"] and words.count("--set") == len(sets) + 2, "and the pictures' size"
    again = busybot(*words[1:], "--workers", "1")
    assert again.returncode == 0, again.stderr
    Dataset.open(Path(out)).episode_path(1).unlink()
    refused = busybot("collect", out, "--policy", "random", "--steps", "1", *SMALL[:4])
    hint = refused.stderr.split("hint: ")[1].split("; or collect into another dataset")[0]
    assert "null" not in hint and "learned." not in hint, "of another policy's settings there are too many"


def test_tasks_are_recorded_with_their_goals_by_the_learned_policy(tmp_path: Path) -> None:
    out = str(tmp_path / "tasks")
    refused = busybot("generate", out, "--tasks", "one-to-many", "--relations", "one-to-one")
    assert refused.returncode == 2 and "leave relations out" in refused.stderr and not Path(out).exists()
    made = busybot("generate", out, "--tasks", "one-to-many", "--boards", "1")
    assert made.returncode == 0 and "1 board with one-to-many tasks" in made.stderr, made.stderr
    collected = busybot("collect", out, "--steps", "0", "--workers", "1", *SMALL[:4], "--json")
    assert collected.returncode == 0, collected.stderr
    info = json.loads(busybot("dataset", "info", out, "--json").stdout)
    assert (info["tasks"], info["policy"], info["episodes"]) == ("one-to-many", "learned", 1)
    assert read_episode(Path(out) / "episodes" / "000000.mcap").goal is not None
    (tmp_path / "config.yaml").write_text("policy: scripted")
    (Path(out) / "episodes" / "000000.mcap").unlink()
    again = busybot("collect", out, "--steps", "0", *SMALL[:4], "--config", str(tmp_path / "config.yaml"))
    assert again.returncode == 0, again.stderr
    assert json.loads(busybot("dataset", "info", out, "--json").stdout)["policy"] == "scripted"


def test_a_world_is_generated_collected_replayed_and_verified(tmp_path: Path) -> None:
    out = str(tmp_path / "hard")
    made = busybot("generate", out, "--world", "mixed", "--boards", "2", "--group-size", "1", "--links", "3-5")
    assert made.returncode == 0 and "2 boards (train, world mixed)" in made.stdout + made.stderr, made.stderr
    collected = busybot("collect", out, "--policy", "scripted", "--workers", "1", *SMALL, "--json")
    assert collected.returncode == 0, collected.stderr
    info = json.loads(busybot("dataset", "info", out, "--json").stdout)
    assert (info["boards"], info["episodes"], info["steps"]) == (2, 2, 6)
    assert busybot("dataset", "verify", out).returncode == 0
    assert busybot("replay", f"{out}/episodes/000001.mcap").stdout.count("holds") == 4
    other = busybot("generate", out, "--world", "time", "--boards", "2", "--group-size", "1")
    assert other.returncode == 1 and "differ" in other.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--world", "sorcery"), "no world 'sorcery'"),
        (("--world", "Gates!"), "world"),
        (("--split", "novel-mechanism"), "name another one: --world gates"),
        (("--tasks", "reach"), "name another one: --world gates"),
        (("--world", "gates", "--tasks", "one-to-one"), "it has --tasks reach"),
        (("--world", "gates", "--relations", "one-to-many"), "has no kinds of relations"),
        (("--world", "clock"), "no link drives the mechanism 'clock'"),
        (("--world", "toggle"), "only the split 'novel-mechanism' has the mechanism 'toggle'"),
        (("--world", "lock", "--set", "depth=[7,8]"), "give --links 8-12"),
        (("--world", "gates", "--links", "many"), "--links 'many' is no range"),
        (("--world", "gates", "--links", "-3"), "--links '-3' is no range"),
        (("--world", "gates", "--links", "6-3"), "--links '6-3' is no range"),
        (("--world", "gates", "--links", "40-60"), "number of trigger links on a board, at most 32, as 3-6"),
        (("--world", "gates", "--set", "links=[6,3]"), "links: the range 6..3 is empty"),
        (("--world", "Gates"), "did you mean gates? choose from paper"),
        (("--world", "gaets"), "did you mean gates? choose from paper"),
        (("--world", "kitchn"), "did you mean kitchen? choose from paper"),
        (("--world", "room", "--split", "novel-mechanism"), "the world 'room' has no split 'novel-mechanism'"),
        (("--world", "kitchen", "--tasks", "one-to-one"), "it has --tasks reach"),
        (("--world", "real-board", "--tasks", "reach"), "the world 'real-board' has"),
    ],
)
def test_worlds_and_links_that_there_are_not_are_told(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    result = busybot("generate", str(tmp_path / "out"), *arguments)
    assert result.returncode == 2 and message in result.stderr and "hint:" in result.stderr, result.stderr
    assert "Traceback" not in result.stderr and not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_killed_collection_of_a_world_is_continued(tmp_path: Path) -> None:
    folders = [tmp_path / "straight", tmp_path / "killed"]
    for folder in folders:
        assert busybot("generate", str(folder), "--world", "mixed", "--boards", "6").returncode == 0
    arguments = ("--policy", "scripted", "--workers", "1", *SMALL)
    assert busybot("collect", str(folders[0]), *arguments).returncode == 0
    for count in (1, 2, 4):
        done = partial(lambda count: len(list((folders[1] / "episodes").glob("*.mcap"))) >= count, count)
        kill_once(["collect", str(folders[1]), *arguments], done)
    assert busybot("collect", str(folders[1]), *arguments).returncode == 0
    assert busybot("dataset", "verify", str(folders[1])).returncode == 0
    assert busybot("dataset", "diff", *map(str, folders)).stdout.strip().endswith("are equal")


def test_where_a_picture_of_a_replay_goes_is_checked_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("")
    for name, said in (
        *(("folder.png", "is a folder"), ("", "is a folder"), ("file/shot.png", "file is no folder")),
        ("shot.jpg", "it writes .png files"),
    ):
        refused = busybot("replay", "nowhere.mcap", "--step", "1", "--screenshot", str(tmp_path / name))
        told = " ".join(refused.stderr.split())
        assert refused.returncode == 1 and said in told and "nowhere" not in told, refused.stderr


@pytest.mark.long
def test_recorded_frozen_and_made_again(tmp_path: Path) -> None:
    out, again = str(tmp_path / "data"), str(tmp_path / "again")
    busybot("generate", out, "--boards", "2", "--tasks", "one-to-many")
    collected = busybot("collect", out, "--policy", "scripted", "--workers", "1", *SMALL)
    assert collected.returncode == 0, collected.stderr
    frozen = busybot("dataset", "freeze", out, "--workers", "1", "--json")
    assert frozen.returncode == 0 and json.loads(frozen.stdout)["objects_carried"] > 10, frozen.stderr
    refused = busybot("collect", out, "--policy", "scripted", *SMALL)
    assert refused.returncode == 1 and "frozen" in refused.stderr and "Traceback" not in refused.stderr
    episode, picture = f"{out}/episodes/000001.mcap", tmp_path / "step.png"
    replayed = busybot("replay", episode, "--step", "2", "--screenshot", str(picture), "--json")
    assert replayed.returncode == 0, replayed.stderr
    told = json.loads(replayed.stdout)
    assert told["ok"] and told["steps"][0]["step"] == 2 and told["steps"][0]["rule"] == "equal"
    assert cv2.imread(str(picture)).shape == (120, 160, 3)
    assert busybot("replay", episode).stdout.count("holds") == 4
    beyond = busybot("replay", episode, "--step", "9")
    assert beyond.returncode == 1 and "0 (the start) to 3" in beyond.stderr and episode in beyond.stderr
    done = busybot("dataset", "regenerate", out, "--out", again, "--workers", "1", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["episodes"] == {"equal": 2, "close": 0}
    assert busybot("dataset", "diff", out, again).stdout.strip().endswith("are equal")
    (tmp_path / "again/episodes/000000.mcap").write_bytes((tmp_path / "data/episodes/000001.mcap").read_bytes())
    differs = busybot("dataset", "regenerate", out, "--out", again, "--workers", "1")
    assert differs.returncode == 1 and "NOT as recorded" in differs.stdout


def test_faults_name_the_place_and_the_hint(tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "file").touch()
    for arguments, message in (
        (("generate", str(full)), "not an empty folder"),
        (("generate", str(tmp_path / "b"), "--assets", str(tmp_path / "none")), "not a folder"),
        (("collect", str(tmp_path / "none")), "no such folder"),
        (("collect", str(full)), "not a dataset"),
    ):
        result = busybot(*arguments)
        assert result.returncode == 1, arguments
        assert message in result.stderr and "hint:" in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "b").exists()


def test_what_is_wrong_in_a_file_is_no_wrong_usage(tmp_path: Path) -> None:
    file, out = tmp_path / "boards.yaml", tmp_path / "out"
    file.write_text("lamps: [12, 13]")
    by_file = busybot("generate", out, "--config", file)
    assert by_file.returncode == 1 and f"{file}: lamps: at least 12 do not fit" in by_file.stderr
    typed = busybot("generate", out, "--set", "lamps=[12,13]")
    assert typed.returncode == 2 and "the defaults are lamps [3, 5], responders [5, 6]" in typed.stderr
    file.write_text("lamps: [3, 4]")
    mixed = busybot("generate", out, "--config", file, "--set", "boards=0")
    assert mixed.returncode == 2 and "parameter boards" in mixed.stderr and not out.exists()


def test_the_next_command_moves_something_and_a_dataset_keeps_its_number(tmp_path: Path) -> None:
    out = tmp_path / "data"
    made = busybot("generate", out, "--boards", "3", "--group-size", "1")
    assert f"next: busybot collect {out} --policy learned\n" in made.stderr
    again = busybot("generate", out, "--group-size", "1", "--json")
    assert again.returncode == 0 and json.loads(again.stdout)["boards"] == 3
    grown = busybot("generate", out, "--group-size", "1", "--set", "boards=4", "--json")
    assert json.loads(grown.stdout)["boards"] == 4
    tasks = busybot("generate", tmp_path / "tasks", "--tasks", "one-to-one", "--boards", "1")
    assert f"next: busybot collect {tmp_path / 'tasks'}\n" in tasks.stderr, "with tasks it is learned already"


def test_wrong_usage_exits_with_2() -> None:
    assert busybot("generate").returncode == 2
    assert busybot("collect", "x", "--no-such-option").returncode == 2


def test_faults_of_the_file_system_are_told_without_traceback(tmp_path: Path) -> None:
    for arguments in (("generate", "/dev/null/x", "--boards", "1", "--json"), ("generate", "/proc/nowhere/x")):
        result = busybot(*arguments)
        assert result.returncode == 1 and "Traceback" not in result.stderr
        assert "hint:" in result.stderr
    assert "error" in json.loads(busybot("generate", "/dev/null/x", "--json").stdout)


def test_the_option_wins_over_file_and_set(tmp_path: Path) -> None:
    result = busybot("generate", str(tmp_path / "d"), "--boards", "1", "--set", "seed=3", "--seed", "0", "--json")
    assert json.loads(result.stdout)["seed"] == 0


def test_views_that_show_nothing_are_refused(tmp_path: Path) -> None:
    assert busybot("generate", str(tmp_path / "d"), "--boards", "1").returncode == 0
    for setting, message in (
        ("render.near=7", "between near 7 and far 6"),
        ("render.position=[0,0,0]", "same point"),
        ("interaction.force_limit=.inf", "force_limit"),
        ("interaction.delta=many", "interaction.delta"),
    ):
        result = busybot("collect", str(tmp_path / "d"), "--set", setting)
        assert result.returncode == 2 and message in result.stderr and "Traceback" not in result.stderr, result.stderr


def test_generating_again_changes_nothing_and_refuses_anything_else(tmp_path: Path) -> None:
    folder = tmp_path / "boards"
    assert busybot("generate", str(folder), "--boards", "2").returncode == 0
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    again = busybot("generate", str(folder), "--boards", "2", "--json")
    assert again.returncode == 0 and json.loads(again.stdout)["boards"] == 2
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    other = busybot("generate", str(folder), "--boards", "2", "--seed", "1")
    assert other.returncode == 1 and "seed differ" in other.stderr and "hint:" in other.stderr


def files_of(folder: Path) -> dict[str, bytes]:
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != LOCK_FILE)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def test_a_dataset_grows_as_if_it_had_been_drawn_at_once(tmp_path: Path) -> None:
    grown, once = tmp_path / "grown" / "boards", tmp_path / "once" / "boards"
    words = ("--seed", "3", "--group-size", "4", "--split", "novel-object")
    assert busybot("generate", grown, "--boards", "6", *words).returncode == 0
    first = files_of(grown)
    for wrong, message in (
        (("--boards", "11", *words, "--uniform"), "uniform differs (was False, now True)"),
        (("--boards", "5", *words), "boards differs (was 6, now 5)"),
        (("--boards", "11", "--seed", "4", *words[2:]), "seed differs (was 3, now 4)"),
    ):
        refused = busybot("generate", grown, *wrong)
        assert refused.returncode == 1 and message in refused.stderr and files_of(grown) == first
    assert json.loads(busybot("generate", grown, "--boards", "11", *words, "--json").stdout)["boards"] == 11
    assert busybot("generate", once, "--boards", "11", *words).returncode == 0
    assert files_of(grown) == files_of(once) != first


def test_boards_that_a_killed_growth_left_are_no_obstacle_and_other_boards_are_kept(tmp_path: Path) -> None:
    folder, more = tmp_path / "a" / "boards", tmp_path / "b" / "boards"
    assert busybot("generate", folder, "--boards", "2").returncode == 0
    assert busybot("generate", more, "--boards", "5").returncode == 0
    shard = "boards/boards-00000.jsonl"
    (folder / shard).write_bytes((more / shard).read_bytes())  # killed before it wrote dataset.json
    assert busybot("generate", folder, "--boards", "5").returncode == 0
    assert files_of(folder) == files_of(more)
    (more / shard).write_text((more / shard).read_text().replace('"seed":0', '"seed":1', 1))
    edited = files_of(more)
    refused = busybot("generate", more, "--boards", "6")
    assert refused.returncode == 1 and "drawn otherwise today" in refused.stderr and files_of(more) == edited
    assert sorted(path.name for path in tmp_path.glob("*/*")) == ["boards", "boards"]


@pytest.mark.long
def test_a_dataset_with_episodes_grows_and_is_collected_further_unless_it_is_frozen(tmp_path: Path) -> None:
    grown, once = tmp_path / "grown" / "boards", tmp_path / "once" / "boards"
    few = ("--policy", "scripted", "--workers", "1", *SMALL)
    for folder, boards in ((grown, 1), (once, 3), (grown, 3)):
        assert busybot("generate", folder, "--boards", boards).returncode == 0
        collected = busybot("collect", folder, *few)
        assert collected.returncode == 0, collected.stderr
    assert busybot("dataset", "diff", grown, once).stdout.strip().endswith("are equal")
    told = [json.loads(busybot("dataset", "info", folder, "--json").stdout) for folder in (grown, once)]
    assert told[0] == told[1] and told[0]["episodes"] == 3
    assert busybot("dataset", "verify", grown).returncode == 0
    assert busybot("dataset", "freeze", grown, "--workers", "1").returncode == 0
    assert busybot("generate", grown, "--boards", "3").returncode == 0
    refused = busybot("generate", grown, "--boards", "4")
    assert refused.returncode == 1 and "the dataset is frozen" in refused.stderr


def test_a_killed_generate_is_made_again_but_nothing_else_is_overwritten(tmp_path: Path) -> None:
    straight, folder = tmp_path / "straight" / "boards", tmp_path / "boards"
    assert busybot("generate", str(straight), "--boards", "2").returncode == 0
    code = (  # killed when everything but the last step is done
        "import os, sys; os.rename = lambda *paths, real=os.rename, **folders:"
        " os.kill(os.getpid(), 9) if paths[1] == os.path.basename(sys.argv[2]) else real(*paths, **folders);"
        " from busybot.__main__ import main; main()"
    )
    killed = subprocess.run([sys.executable, "-c", code, "generate", str(folder), "--boards", "2"])
    assert killed.returncode == -9 and not folder.exists()
    assert [path.name[:8] for path in tmp_path.iterdir() if path.name != "straight"] == [".boards-"]
    assert busybot("generate", str(folder), "--boards", "2").returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["boards", "straight"]
    for path in straight.rglob("*"):
        assert path.is_dir() or path.read_bytes() == (folder / path.relative_to(straight)).read_bytes()
    (folder / "dataset.json").unlink()
    refused = busybot("generate", str(folder), "--boards", "2")
    assert refused.returncode == 1 and "not an empty folder" in refused.stderr
