"""The results of a run as rows of Tables 1 to 3, and what the stages cost: files that `busybot report` reads.

    python -m pipelines.tables runs/smoke

writes `runs/smoke/tables`: what the run's profile asks for, whatever else former values left in its folder. What a
stage did not make is left out, and shown as missing in the report.
"""

import shutil
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import PLANNING, REASONING
from busybot.evaluation.results import stamp, write_result
from pipelines.profile import Profile, profile_of, run_of
from pipelines.stage import Note, note_of, read_note

NOVEL = ("novel-config", "novel-object")


def interaction(run: Path, asked: Profile) -> dict[str, Any]:
    """Rows of Table 1: the trained policy under its variant and seed, and chance."""
    rows = {}
    model = _known(run / "interact" / "model" / "model.json")
    if model is not None:
        training = model["training"] | {"cost": _cost(run / "interact")}
        name = "paper" if model.get("variant") == "paper" else f"free-{training['seed']}"
        rows[name] = {"training": training, **_judged(run, asked, "", [run / "interact"])}
    rows["random"] = {"training": None, **_judged(run, asked, "-random", [])}
    return rows


def _judged(run: Path, asked: Profile, suffix: str, outs: list[Path]) -> dict[str, Any]:
    found = {}
    for split, out, result in _results(run, "judged", asked.judge.splits, suffix):
        found[split] = result
        outs = [*outs, run / "judge" / split, out]
    return {"commands": typed(outs), **found}


def _results(run: Path, place: str, names: Iterable[str], suffix: str = "") -> Iterator[tuple[str, Path, Any]]:
    """Name, folder and content of the results that are there."""
    for name in names:
        out = run / place / f"{name}{suffix}"
        if (out / "result.json").is_file():
            yield name, out, read_json(out / "result.json")


def reasoning(run: Path, asked: Profile) -> dict[str, Any]:
    """Rows of Table 2: the trained model under its kind, and those that learn nothing."""
    rows = {}
    model = _known(run / "reason" / "model" / "model.json")
    if model is not None:
        training = model["training"] | {"cost": _cost(run / "reason")}
        before = [run / "data" / "train", run / "data" / "train.features", run / "reason"]
        rows[model["model"]] = {"training": [training], **_inferred(run, asked, "", before)}
    for name in asked.relations.baselines:
        told = _inferred(run, asked, f"-{name}", [])
        if told["splits"]:
            rows[name] = {"training": [], **told}
    return rows


def _inferred(run: Path, asked: Profile, suffix: str, outs: list[Path]) -> dict[str, Any]:
    found = {}
    for name, out, result in _results(run, "relations", asked.relations.sets, suffix):
        scores = {key: result[key] for key in REASONING.keys}
        found[name] = {"mean": scores, "least": scores, "most": scores, "seeds": [result]}
        outs = [*outs, run / "data" / name, run / "data" / f"{name}.features", out]
    return {"commands": typed(outs), "splits": found}


def planning(run: Path, asked: Profile) -> dict[str, Any]:
    """Rows of Table 3: all agents that played."""
    rows: dict[str, Any] = {row.name: {"splits": {}} for row in PLANNING.rows}
    outs: list[Path] = []
    for name, out, result in _results(run, "planned", asked.tasks.cells):
        split, kind = asked.tasks.cells[name]
        for agent, scores in result["agents"].items():
            rows.setdefault(agent, {"splits": {}})["splits"].setdefault(split, {})[kind] = scores
        outs += [run / "tasks" / name, out]
    commands = typed(outs)
    return {agent: {"commands": commands, **row} for agent, row in rows.items() if row["splits"]}


def notes(run: Path, asked: Profile) -> Iterator[tuple[str, Note]]:
    """What is known of every stage that the profile asks for, in the order in which they ended."""
    files = {name: file for name in stages_of(asked) if (file := note_of(run / name)).is_file()}
    for name in sorted(files, key=lambda name: files[name].stat().st_mtime_ns):
        yield name, read_note(files[name])


def stages_of(asked: Profile) -> list[str]:
    """What the stages that are noted make, beneath the folder of a run."""
    acted = [(f"judge/{one}", f"judged/{one}", f"judged/{one}-random") for one in asked.judge.splits]
    recorded = [(f"data/{one}", f"data/{one}.features") for one in asked.data.sets]
    inferred = [(one, *(f"{one}-{model}" for model in asked.relations.baselines)) for one in asked.relations.sets]
    played = [(f"tasks/{one}", f"planned/{one}", f"rollouts/{one}") for one in asked.tasks.cells]
    names = [name for several in (*acted, *recorded, *played) for name in several]
    return ["interact", "reason", *names, *(f"relations/{name}" for several in inferred for name in several)]


def typed(outs: list[Path]) -> list[str]:
    """The commands that made these outputs, without the place of objects on this machine."""
    found: dict[str, None] = {}
    for out in outs:
        for command in read_note(file).commands if (file := note_of(out)).is_file() else []:
            hidden = ["ASSETS" if _names_objects(command, place) else word for place, word in enumerate(command)]
            found[" ".join(["busybot", *hidden])] = None
    return list(found)


def _names_objects(command: list[str], place: int) -> bool:
    return place > 0 and command[place - 1] == "--assets" and command[place] != "procedural"


def _cost(out: Path) -> dict[str, float] | None:
    file = note_of(out)
    return {"seconds": read_note(file).seconds} if file.is_file() else None


def _known(file: Path) -> Any:
    return read_json(file) if file.is_file() else None


def main() -> None:
    run = run_of(sys.argv[1:])
    asked = profile_of(run)
    tables = {"table1": interaction(run, asked), "table2": reasoning(run, asked), "table3": planning(run, asked)}
    assets = {
        result["dataset"]["assets"] for row in tables["table1"].values() for result in map(row.get, NOVEL) if result
    }
    shutil.rmtree(run / "tables", ignore_errors=True)
    command = f"python -m pipelines.tables {run.as_posix() if not run.is_absolute() else 'RUN'}"
    for name, rows in tables.items():
        figures = {"profile": run.name, "assets": ", ".join(sorted(assets)), "rows": rows}
        write_result(run / "tables" / f"{name}.json", {**stamp(name, command=command), **figures})
    stages = {name: note.model_dump(include={"seconds", "cpu_seconds", "done"}) for name, note in notes(run, asked)}
    write_result(run / "tables" / "stages.json", {**stamp("stages", command=command), "stages": stages})


if __name__ == "__main__":
    try:
        main()
    except BusybotError as error:
        sys.exit(f"error: {error}")
