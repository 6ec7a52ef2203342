"""Why a learned agent is behind: the boards it practises on, how it remembers, when it stops.

    python -m benchmarks.studies.learned_agents --data ONE MANY --explored FOLDER --policy-model MODEL --assets DIR \\
        --work FOLDER --out FILE [--boards 30,60,120] [--seeds 2] [--rows lstm,attention,ppo]

`busybot train bc` (`ppo`) practises on so many boards, alike many of each tasks dataset, and is judged on boards of
other appearance groups, a share of `--held-out` that its seed draws: without a simulator, on what `--explored` has of
them. `lstm` and `attention` are BC by how it remembers (`net.memory`). Told are the success at the end of a task on
boards practised on and on others: with the weights that are kept, which are those with the most success on the
others, and so a little too good there, for all rows alike; with those that imitate the demonstrations on the others
best, by which BC was stopped before; and with those of the end, after 1,500 iterations without more success, which
nothing chose.

The command resumes; it is about training boards only.
"""

import argparse
from pathlib import Path
from typing import Any

from benchmarks import runner
from busybot.training.loop import files_of
from busybot.training.run_folder import read_metrics

ROWS: dict[str, tuple[str, ...]] = {
    "lstm": ("bc", *runner.settings("net.memory=lstm")),
    "attention": ("bc", *runner.settings("net.memory=attention")),
    "ppo": ("ppo",),
}


def trained(row: str, boards: int, seed: int, arguments: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is told of a training, and its card."""
    agent, *more = ROWS[row]
    out = arguments.work / f"{row}-{boards}-{seed}"
    data = [word for path in arguments.data for word in ("--data", str(path))]
    places = ("--explored", str(arguments.explored), "--policy-model", arguments.policy_model)
    limits = runner.settings(f"loop.boards={boards}", f"loop.held_out={arguments.held_out}")
    if arguments.minutes:
        limits += runner.settings(f"minutes={arguments.minutes}")
    options = ("--assets", arguments.assets, "--seed", str(seed), *limits, *more)
    told = runner.busybot("train", agent, "--out", str(out), *data, *places, *options)
    training = told["training"]
    keys = ("boards", "boards_held_out", "iterations", "best_iteration", "held_out", "held_out_last")
    judged = [line for line in read_metrics(files_of(out, agent)[1]) if "imitation" in line.get("validation", {})]
    best = min(judged, key=lambda line: line["validation"]["imitation"], default=None)
    imitating = {"iteration": best["iteration"], **best["validation"]} if best else None
    minutes = told["budget"]["minutes"]
    return {
        "seed": seed,
        **{key: training[key] for key in keys},
        "imitating_best": imitating,
        "minutes": minutes,
    }, training


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, nargs="+", required=True, help="tasks datasets with recorded histories")
    options.add_argument("--explored", type=Path, required=True, help="what is known of their boards; continued")
    options.add_argument("--policy-model", required=True, help="interaction model that proposes candidates")
    options.add_argument("--work", type=Path, required=True, help="for trainings; continued if it exists")
    options.add_argument("--boards", default="30,60,120", help="to practise on, comma-separated")
    options.add_argument("--held-out", type=float, default=0.4, help="share of the boards to judge on")
    options.add_argument("--seeds", type=int, default=2)
    options.add_argument("--minutes", type=float, help="of a training at most; by default those of its agent")
    options.add_argument("--rows", default="lstm,attention", help="which")
    arguments = options.parse_args(words)
    result: dict[str, Any] = {"rows": runner.told_rows(arguments.out, "learned-agents")}
    for row in runner.chosen(arguments.rows, ROWS):
        for wanted in map(int, arguments.boards.split(",")):
            runs = [trained(row, wanted, seed, arguments) for seed in range(arguments.seeds)]
            name = f"{row}, {runs[0][0]['boards']}"
            result["rows"][name] = {"seeds": [told for told, _ in runs]}
            origin = {str(number): one for number, one in enumerate(runs[0][1]["data"])}
            hashes = {"models": {"interaction": runs[0][1]["model"]}, "data": origin}
            runner.finish("learned-agents", arguments, result, seed=0, hashes=hashes)
            for told, _ in runs:
                print(name, told["held_out"], "last", told["held_out_last"], flush=True)


if __name__ == "__main__":
    runner.one_of(main)
