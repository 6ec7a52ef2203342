"""Profiles: their values are sound, and a wrong one is named; what stages cost is kept; a run becomes tables."""

import json
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from busybot.cli.main import load_command
from busybot.common.atomic_io import write_json
from busybot.common.config import build
from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import INTERACTION
from busybot.interact.training.config import PaperConfig, TrainConfig
from busybot.reason.models.event.config import EventConfig
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.view.report.report import write_report
from pipelines.profile import FOLDER, OBJECTS, PROCEDURAL, install, profile_of, read_profile, run_of
from pipelines.stage import Note, begin, key_of, note_of, run
from pipelines.summary import metrics
from pipelines.tables import interaction, notes, planning, reasoning, stages_of, typed
from tests.test_imports import PACKAGE, uses
from tests.view.report.test_report import DATASET, reasoned

ROOT = Path(__file__).resolve().parents[2]
DVC = ROOT / ".tools" / "dvc" / "bin"
PROFILES = ("smoke", "laptop", "paper")
STAGES = (
    "import json, sys; from dvc.repo import Repo; "
    "print(json.dumps({stage.addressing: stage.cmd for stage in Repo(sys.argv[1]).index.stages}))"
)


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A folder of profiles to spoil."""
    for name in PROFILES:
        shutil.copytree(FOLDER / name, tmp_path / name)
    return tmp_path


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_is_sound(name: str) -> None:
    assert read_profile(name).profile == name


def test_a_run_is_named_by_one_folder(tmp_path: Path) -> None:
    assert run_of([str(tmp_path)]) == tmp_path
    for words, told in (([], "none is named"), ([str(tmp_path / "x")], "/x"), ([str(tmp_path)] * 2, str(tmp_path))):
        with pytest.raises(BusybotError, match=rf"no folder of a run: .*{told}(.|\n)*runs/smoke"):
            run_of(words)


def test_laptop_and_paper_train_as_the_defaults_say() -> None:
    def config(profile: str, file: str, kind: Any) -> Any:
        return build(kind, FOLDER / profile / file, [], {})

    assert config("laptop", "interact.yaml", TrainConfig) == TrainConfig()
    assert config("laptop", "reason.yaml", EventConfig) == EventConfig()
    assert config("paper", "interact.yaml", PaperConfig) == PaperConfig()
    assert config("paper", "reason.yaml", PaperReasonConfig) == PaperReasonConfig()


def test_paper_has_the_papers_sizes() -> None:
    paper = read_profile("paper")
    assert {name: one.boards for name, one in paper.data.sets.items() if name != "validation"} == {
        "train": 10_000,
        "novel-config": 2_000,
        "novel-object": 2_000,
    }
    assert (paper.data.steps, paper.data.images) == (30, 23) and {one.group for one in paper.data.sets.values()} == {20}
    assert (paper.interact.model, paper.reason.model, paper.reason.encoder) == ("paper", "paper", "resnet50")
    assert paper.tasks.boards == 50 and len(paper.tasks.splits) * len(paper.tasks.kinds) == 6


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("params.yaml", "seed: 0", "sed: 0", r"laptop/params\.yaml: parameter seed: Field required"),
        ("params.yaml", "  images: 23", "  pictures: 23", r"laptop/params\.yaml: parameter data\.images: "),
        (
            "params.yaml",
            "train, boards: 100",
            "train, board: 300",
            r"laptop/params\.yaml: parameter data\.sets\.train\.boards: ",
        ),
        ("params.yaml", "seed: 602", "seed: 601", r"data\.sets: two have the same boards"),
        ("params.yaml", "model: event", "model: event\n  modle: x", r"params\.yaml: parameter reason\.modle: Extra"),
        ("params.yaml", "encoder: embedded", "encoder: embeded", r"parameter reason\.encoder: .*'embeded'"),
        ("params.yaml", "encoder: embedded", "encoder: resnet50-all", r"params\.yaml: parameter reason\.encoder: "),
        ("params.yaml", "encoder: embedded", "encoder: embedded-centre", r"reason\.encoder: embedded does not encode"),
        ("params.yaml", "agents: search,", "agents: serach,", r"params\.yaml: parameter tasks\.agents: .*'serach'"),
        ("params.yaml", "assets: ../shared", 'assets: "$(rm)', r"laptop/params\.yaml"),
        ("interact.yaml", "steps: 24, p", "step: 24, p", r"laptop/interact\.yaml: parameter rounds\.0\.steps: "),
        ("interact.yaml", "validation: 40", "validations: 40", r"interact\.yaml: parameter validations: Extra inputs"),
        ("reason.yaml", "judge: 50", "juge: 50", r"laptop/reason\.yaml: parameter loop\.juge: Extra inputs"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_place(copied: Path, file: str, old: str, new: str, message: str) -> None:
    text = (copied / "laptop" / file).read_text()
    assert old in text
    (copied / "laptop" / file).write_text(text.replace(old, new, 1))
    with pytest.raises(BusybotError, match=message):
        read_profile("laptop", copied)


@pytest.mark.parametrize("seed", [0, 4])
def test_every_seed_that_a_profile_may_have_is_a_row_of_table_1(copied: Path, tmp_path: Path, seed: int) -> None:
    file = copied / "laptop" / "params.yaml"
    text = file.read_text()
    file.write_text(text.replace("seed: 0", f"seed: {seed}", 1))
    profile = read_profile("laptop", copied)
    write_json(tmp_path / "interact/model/model.json", {"variant": "fast", "training": {"seed": profile.seed}})
    assert set(interaction(tmp_path, profile)) <= {row.name for row in INTERACTION.rows}
    file.write_text(text.replace("seed: 0", "seed: 5", 1))
    with pytest.raises(BusybotError, match=r"laptop/params\.yaml: parameter seed: "):
        read_profile("laptop", copied)


@pytest.mark.parametrize(
    "line",
    ["interaction: {strict: true}", "inputs: rgb", "responders: false", "interaction: {reward: joints, delta: 100}"],
)
def test_a_training_of_another_row_is_not_told_as_ours(copied: Path, line: str) -> None:
    """It would be called ours of free mode, and held to its gate."""
    file = copied / "laptop" / "interact.yaml"
    file.write_text(f"{file.read_text()}{line}\n")
    name = line.partition(": ")[0]
    with pytest.raises(
        BusybotError, match=rf"laptop/interact\.yaml: parameter {name}(.|\n)*benchmarks\.tables\.table1"
    ):
        read_profile("laptop", copied)
    file.write_text("interaction: {strict: false, delta: 400}\ninputs: depth\nwindow: 5000\n")
    assert read_profile("laptop", copied).interact.model == "fast"


def test_a_profile_becomes_the_pipelines_values(copied: Path, tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    install("smoke", params, folder=copied)
    text = (copied / "smoke" / "params.yaml").read_text()
    assert params.read_text() == text + OBJECTS.format(f'"{PROCEDURAL}"') and (ROOT / PROCEDURAL).is_dir()
    assert params.read_text() == (ROOT / "params.yaml").read_text(), "what is committed is the pipeline's"
    tiny = ROOT / "datasets" / "tiny" / "objects"
    written = params.stat().st_mtime_ns
    install("smoke", params, folder=copied)
    assert params.stat().st_mtime_ns == written, "the same values are not written again"
    install("laptop", params, str(tiny), copied)
    text = (copied / "laptop" / "params.yaml").read_text()
    text = text.replace("assets: ../shared/partnet-mobility", f'assets: "{tiny}"')
    assert params.read_text() == text + OBJECTS.format(f'"{tiny}"')
    with pytest.raises(BusybotError, match=r"nowhere(.|\n)*ASSETS=DIR"):
        install("laptop", params, "nowhere", copied)
    with pytest.raises(BusybotError, match=r"no profile 'huge'(.|\n)*laptop or paper or smoke"):
        install("huge", params, folder=copied)


def test_a_run_was_asked_for_what_the_pipelines_values_say(copied: Path, tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    assert profile_of(Path("runs/smoke"), params) == read_profile("smoke"), "nothing is installed"
    install("smoke", params, folder=copied)
    params.write_text(params.read_text().replace("splits: [novel-config, novel-object]", "splits: [novel-config]"))
    assert profile_of(Path("runs/smoke"), params).judge.splits == ["novel-config"]
    assert profile_of(Path("runs/laptop"), params) == read_profile("laptop"), "another profile is installed"
    with pytest.raises(BusybotError, match="no profile 'huge'"):
        profile_of(Path("runs/huge"), params)


def commands(words: list[str]) -> Iterator[list[str]]:
    """busybot's commands in a stage's."""
    if words[:3] == ["python", "-m", "pipelines.stage"]:
        while "--" in words:
            words = words[words.index("--") + 1 :]
            yield words[: words.index("--")] if "--" in words else words
    elif words[0] == "busybot":
        yield words[1:]


def parse(words: list[str]) -> str:
    """Read a command's words as busybot does, without doing anything; the command's name."""
    command: Any = load_command(words[0])
    name, words = [words[0]], words[1:]
    while hasattr(command, "commands"):
        name.append(words[0])
        command, words = command.commands[words[0]], words[1:]
    command.make_context(name[-1], list(words))
    return " ".join(name)


@pytest.mark.parametrize("name", PROFILES)
def test_busybot_takes_the_commands_of_every_stage(name: str, tmp_path: Path) -> None:
    if not (DVC / "dvc").exists():
        pytest.skip("DVC is not installed: `make dvc` does it")
    (tmp_path / ".dvc").mkdir()
    shutil.copy(ROOT / ".dvc" / "config", tmp_path / ".dvc" / "config")
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    values = (FOLDER / name / "params.yaml").read_text()
    (tmp_path / "params.yaml").write_text(values + OBJECTS.format("objects"))
    said = subprocess.run([DVC / "python", "-c", STAGES, tmp_path], capture_output=True, text=True, check=True)
    stages: dict[str, Any] = json.loads(said.stdout)
    lines = [line for line_or_more in stages.values() for line in _lines(line_or_more)]
    names = [parse(words) for line in lines for words in commands(shlex.split(line))]
    profile = read_profile(name)
    cells, sets = len(profile.tasks.splits) * len(profile.tasks.kinds), len(profile.relations.sets)
    assert names.count("train interact") == names.count("train reason") == names.count("report") == 1
    assert names.count("features") == len(profile.data.sets) and names.count("eval plan") == 2 * cells
    assert names.count("eval interact") == 2 * len(profile.judge.splits)
    assert names.count("eval reason") == sets * (1 + len(profile.relations.baselines))
    outs = [words[words.index("pipelines.stage") + 1] for line in lines if "pipelines.stage" in (words := line.split())]
    assert sorted(outs) == sorted(f"runs/{name}/{one}" for one in stages_of(profile)), "all of them are noted"
    assert names.count("generate") == len(profile.judge.splits) + len(profile.data.sets) + cells


USED = {
    "generate": ("datasets/create.py",),
    "collect": ("sim/collect.py", "interact/policy/policy_factory.py"),
    "features": ("reason/inputs/feature_store.py",),
    "train interact": ("interact/training/fast.py", "interact/training/paper.py"),
    "train reason": ("reason/train.py",),
    "eval interact": ("interact/evaluate.py", "interact/policy/policy_factory.py"),
    "eval reason": ("reason/evaluation/evaluate.py",),
    "eval plan": ("plan/evaluate.py",),
}
"""What does a command's work."""


def test_a_stage_depends_on_the_objects_and_on_all_code_that_its_commands_use() -> None:
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    told = {name: stage.get("do", stage) for name, stage in stages.items()}
    told = {name: stage for name, stage in told.items() if "pipelines.stage" in stage["cmd"]}
    assert len(told) == 12
    for name, stage in told.items():
        deps = set(stage["deps"])
        for words in commands(shlex.split(stage["cmd"])):
            command = words[0] if words[0] in USED else " ".join(words[:2])
            used = set().union(*(folders(f"busybot.{file}".replace("/", ".")[:-3]) for file in USED[command]))
            lacking = {one for one in used if not any(f"busybot/{one}/".startswith(f"{dep}/") for dep in deps)}
            assert not lacking, f"{name} also depends on {sorted(lacking)}"
            assert deps & {f"busybot/cli/{words[0]}", f"busybot/cli/{words[0]}.py"}
        assert ("${objects}" in deps) == ("--assets" in stage["cmd"]), name


def test_it_is_told_which_stages_begin_anew() -> None:
    """DVC removes what they left behind before they run again."""
    text, guide = (ROOT / "dvc.yaml").read_text(), (ROOT / "docs" / "guides" / "reproduce.md").read_text()
    stages = {name: stage.get("do", stage) for name, stage in yaml.safe_load(text)["stages"].items()}
    made = {name: [*stage.get("outs", []), *stage.get("metrics", [])] for name, stage in stages.items()}
    kept = {name for name, outs in made.items() if all(isinstance(one, dict) and _persists(one) for one in outs)}
    *names, last = (f"`{name}`" for name in stages if name not in kept)
    told = f"{', '.join(names)} and {last} begin anew"
    assert told in " ".join(text.replace("\n# ", "\n").split()) and told in guide


def _persists(out: dict[str, Any]) -> bool:
    return all(options.get("persist", False) for options in out.values())


def folders(module: str) -> set[str]:
    """Of the package, those with modules that a module imports, directly or not."""
    known, todo = set[Path](), {module}
    while todo:
        name = todo.pop()
        file = PACKAGE.parent / f"{name.replace('.', '/')}.py"
        if file.is_file() and file not in known:
            known.add(file)
            todo |= {part for one in uses(file) for part in (one, one.rpartition(".")[0])}
    return {file.parent.relative_to(PACKAGE).as_posix() for file in known} - {"."}


def test_the_key_of_a_stage_changes_with_the_objects_that_it_names(tmp_path: Path) -> None:
    objects = tmp_path / "objects"
    objects.mkdir()
    (objects / "lamp.urdf").write_text("<robot/>")
    command, other = (["generate", "d", "--assets", str(objects)], ["generate", "d", "--assets", "procedural"])
    before = key_of([command], []), key_of([other], [])
    (objects / "lamp.urdf").write_text("<robot></robot>")
    after = key_of([command], []), key_of([other], [])
    assert after[0] != before[0] and after[1] == before[1]


def _lines(command: str | list[str]) -> list[str]:
    return [command] if isinstance(command, str) else command


def test_a_stage_notes_its_commands_and_time_and_begins_anew_when_its_key_changed(tmp_path: Path) -> None:
    out, asked = tmp_path / "data" / "train", [["--version"]]
    first = begin([out], "a", asked)
    assert run([["no-such-command"], *asked], first, note_of(out)) == 2
    assert begin([out], "a", asked).seconds > 0, "also where the output is only there at the end"
    out.mkdir(parents=True)
    second = begin([out], "a", asked)
    assert second.seconds > 0 and not second.done and out.exists()
    assert run(asked, second, note_of(out)) == 0
    ((name, third),) = notes(tmp_path, read_profile("smoke"))
    assert name == "data/train" and third.seconds > second.seconds and third.done
    assert begin([out], "b", asked).seconds == 0 and not out.exists()
    other = tmp_path / "elsewhere"
    other.mkdir()
    out.symlink_to(other)
    begin([out], "c", asked)
    assert not out.is_symlink() and other.is_dir(), "a link itself is removed, not what it leads to"


@pytest.mark.parametrize("text", ['{"key": "a", ', "[" * 100_000, "[]", '{"key": "a"}', '{"key": 3, "commands": []}'])
def test_a_damaged_note_is_named(tmp_path: Path, text: str) -> None:
    out = tmp_path / "interact"
    begin([out], "a", [["--version"]])
    note_of(out).write_text(text)
    profile = read_profile("smoke")
    for reading in (lambda: begin([out], "a", []), lambda: list(notes(tmp_path, profile)), lambda: typed([out])):
        with pytest.raises(
            BusybotError, match=r"\.stages/interact\.json: (.|\n)*hint: remove it: the stage begins anew"
        ):
            reading()
    note_of(out).unlink()
    assert not begin([out], "a", [["--version"]]).done


class Heard(subprocess.Popen[bytes]):
    """A command that is waited for while somebody presses Ctrl-C."""

    def wait(self, timeout: float | None = None) -> int:
        if timeout is not None and not hasattr(self, "pressed"):
            self.pressed = True
            raise KeyboardInterrupt
        return super().wait(timeout)


def test_after_ctrl_c_a_stage_waits_for_its_command_and_begins_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "Popen", Heard)
    commands, file = [["--version"], ["assets", "make", str(tmp_path / "made")]], tmp_path / "note.json"
    assert run(commands, Note(key="", commands=commands), file) == 130
    assert not (tmp_path / "made").exists() and not json.loads(file.read_text())["done"]


def test_costs_of_complete_runs_do_not_add_up(tmp_path: Path) -> None:
    out, asked, profile = tmp_path / "interact", [["--version"]], read_profile("smoke")
    out.mkdir()
    done = Note(key="a", commands=asked, seconds=9900.0, cpu_seconds=8800.0, done=True)
    write_json(note_of(out), done.model_dump())
    assert run(asked, begin([out], "a", asked), note_of(out)) == 0
    assert [one for _, one in notes(tmp_path, profile)] == [done], "its outputs were there"
    out.rmdir()
    assert run(asked, begin([out], "a", asked), note_of(out)) == 0
    assert 0 < next(one for _, one in notes(tmp_path, profile)).seconds < 9900, "this run made them"


def test_the_place_of_objects_is_not_told(tmp_path: Path) -> None:
    for name, assets in (("one", "/home/someone/objects"), ("two", "procedural")):
        begin([tmp_path / name], "k", [["generate", name, "--assets", assets]])
    outs = [tmp_path / "one", tmp_path / "two", tmp_path / "none"]
    assert typed(outs) == ["busybot generate one --assets ASSETS", "busybot generate two --assets procedural"]


@pytest.mark.long
def test_a_run_becomes_rows_of_the_tables(tmp_path: Path) -> None:
    origin = DATASET | {"assets": "made"}
    begin([tmp_path / "reason"], "k", [["train", "reason"]])
    write_json(tmp_path / "interact/model/model.json", {"variant": "fast", "training": {"seed": 0}})
    write_json(tmp_path / "reason/model/model.json", {"model": "event", "training": {"seed": 0, "data": []}})
    acted = {"precision": 0.99, "recall": 0.9, "boards": 3, "intervals": {}, "dataset": origin}
    write_json(tmp_path / "judged/novel-config/result.json", acted)
    write_json(tmp_path / "judged/novel-config-random/result.json", acted | {"recall": 0.1})
    write_json(tmp_path / "relations/validation/result.json", reasoned())
    write_json(tmp_path / "relations/novel-object-count/result.json", reasoned(pred_a=None, pred_a_successful=None))
    told = {"agents": {"search": {"success": 0.5}}, "kinds": {"one-to-one": 1}, "tasks": 1, "dataset": origin}
    write_json(tmp_path / "planned/train-one-to-one/result.json", told)
    asked = read_profile("laptop")
    made = (interaction(tmp_path, asked), reasoning(tmp_path, asked), planning(tmp_path, asked))
    tables = dict(zip(("table1", "table2", "table3"), made, strict=True))
    assert {name: set(rows) for name, rows in tables.items()} == {
        "table1": {"free-0", "random"},
        "table2": {"event", "count"},
        "table3": {"search"},
    }
    assert tables["table2"]["event"]["commands"] == ["busybot train reason"]
    for name, rows in tables.items():
        write_json(tmp_path / "tables" / f"{name}.json", {"kind": name, "rows": rows})
    done = write_report([tmp_path / "tables"], tmp_path / "report")
    judged = {(one.row.name, one.split, one.key): one.reached for one in done.verdicts if one.reached is not None}
    assert judged["free-0", "novel-config", "precision"] and judged["free-0", "novel-config", "recall"] is False
    assert judged["event", "validation", "edge_p"] and judged["search", "train", "one-to-one"] is False
    assert len(judged) == 2 + 4 + 1


def test_a_paper_model_is_not_told_as_ours(tmp_path: Path) -> None:
    write_json(tmp_path / "interact/model/model.json", {"variant": "paper", "training": {"seed": 0}})
    write_json(tmp_path / "reason/model/model.json", {"model": "paper", "training": {"seed": 0}})
    asked = read_profile("paper")
    assert "paper" in interaction(tmp_path, asked) and "free-0" not in interaction(tmp_path, asked)
    assert set(reasoning(tmp_path, asked)) == {"paper"}


def test_what_a_profile_no_longer_asks_for_is_in_no_table(tmp_path: Path) -> None:
    """DVC leaves the outputs of stages that left the matrix where they are."""
    write_json(tmp_path / "reason/model/model.json", {"model": "event", "training": {"seed": 0}})
    acted = {"precision": 0.9, "recall": 0.9, "precision_exploring": 0.9, "boards": 3}
    for split in ("novel-config", "novel-object"):
        for suffix in ("", "-random"):
            begin([tmp_path / f"judged/{split}{suffix}"], "k", [["eval", "interact"]])
            write_json(tmp_path / f"judged/{split}{suffix}/result.json", acted)
    inferred = reasoned() | {"edge_r_bound": None, "pred_a_bound": None, "boards": 3}
    for name in ("validation", "novel-config", "novel-config-count", "novel-config-lookup"):
        write_json(tmp_path / f"relations/{name}/result.json", inferred)
    for cell in ("novel-object-one-to-many", "novel-object-one-to-one", "train-one-to-many"):
        write_json(tmp_path / f"planned/{cell}/result.json", {"agents": {"search": {}}, "success": 0.5, "tasks": 1})
    asked = read_profile("smoke")
    less = {
        "judge": asked.judge.model_copy(update={"splits": ["novel-config"]}),
        "relations": asked.relations.model_copy(update={"sets": ["novel-config"]}),
    }
    asked = asked.model_copy(update=less)
    acting, inferring, playing = (table(tmp_path, asked) for table in (interaction, reasoning, planning))
    assert {name for name, _ in notes(tmp_path, asked)} == {"judged/novel-config", "judged/novel-config-random"}
    assert set(acting["random"]) == {"training", "commands", "novel-config"}
    assert {name: set(row["splits"]) for name, row in inferring.items()} == {
        "event": {"novel-config"},
        "count": {"novel-config"},
    }
    assert {split: set(kinds) for split, kinds in playing["search"]["splits"].items()} == {
        "novel-object": {"one-to-many"}
    }
    assert {skill: set(splits) for skill, splits in metrics(tmp_path, asked).items()} == {
        "interact": {"novel-config"},
        "relations": {"novel-config"},
        "plan": {"novel-object-one-to-many"},
    }
