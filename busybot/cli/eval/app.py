"""`busybot eval`: measure a skill on a dataset."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from busybot.cli.common import (
    CONTEXT,
    answer,
    check_file,
    counted,
    episode_progress,
    print_json,
    processes,
    say,
    tell,
    warn,
)
from busybot.cli.eval import printing
from busybot.cli.options import (
    AssetsOption,
    DeviceOption,
    JsonOption,
    SeedOption,
    StrictOption,
    WorkersOption,
    interaction_models,
    offering,
    reasoners,
)
from busybot.common.errors import UsageError

if TYPE_CHECKING:
    from busybot.datasets.dataset import Dataset
    from busybot.interact.evaluate import InteractEvaluation
    from busybot.reason.evaluation.summary import JudgedGraph
    from busybot.sim.policy import AnyPolicyFactory

app = typer.Typer(
    add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Measure a skill on a dataset."
)

OutOption = Annotated[
    Path | None, typer.Option(help="Folder for the results; continues an evaluation stopped under this version.")
]
BUILT_IN = ("random", "scripted")
USUAL_REASONER = "event; mechanism in worlds beyond the paper's"


@app.command()
def reason(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with episodes.")],
    reasoner: Annotated[
        list[str] | None,
        typer.Option(
            help="Who infers relations: count, pc, lookup, persistence, or a trained model. Several are judged "
            "together, which is cheaper.",
            autocompletion=offering(reasoners),
            show_default=USUAL_REASONER,
        ),
    ] = None,
    images: Annotated[int, typer.Option(min=2, help="Infer from so many images, one more than actions.")] = 23,
    decoders: Annotated[
        Path | None, typer.Option(help="Judge predictions by decoders trained on this training dataset, too.")
    ] = None,
    assets: Annotated[
        str | None,
        typer.Option(help="Objects of the boards, for --decoders and for mechanisms, if they are not found by hash."),
    ] = None,
    out: Annotated[
        list[Path] | None,
        typer.Option(help="Write the result as JSON to this file; one for each --reasoner, in their order."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw the scores against the number of images into this file, F.png.")
    ] = None,
    graph: Annotated[
        Path | None,
        typer.Option(
            "--graph",
            "--predictions",
            help="Judge the graphs in this file or folder, as --graphs writes them, instead.",
        ),
    ] = None,
    graphs: Annotated[
        Path | None, typer.Option(help="Write the inferred graph of each board into this folder, JSON and text.")
    ] = None,
    boxes: Annotated[
        Literal["given", "proposed"],
        typer.Option(help="given: the true objects; proposed: what depth and the observed actions show."),
    ] = "given",
    what_if: Annotated[
        bool, typer.Option("--what-if/--no-what-if", help="Ask what would have happened otherwise; it takes longest.")
    ] = True,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of the model.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as change.tolerance=5.")] = None,
    json: JsonOption = False,
) -> None:
    """Which trigger controls which responder, and what the next action does: compared with the truth.

    Models see pictures, boxes and actions. Shares in JSON lie between 0 and 1, in the table they are percent. Pred-A is
    null for count and pc: they predict no states. Where nobody knows the relations, what was inferred is printed.
    """
    from busybot.common.config import build
    from busybot.datasets.dataset import Dataset
    from busybot.evaluation.results import write_result
    from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_models
    from busybot.reason.evaluation.graph_files import read_graphs
    from busybot.reason.models.registry import config_class, usual_reasoner

    target = Dataset.open(dataset)
    if graph is not None and (reasoner or config or set_):
        raise UsageError(
            "--graph judges graphs that are there, and no model", "leave --reasoner, --config and --set out"
        )
    if graph is not None and figure is not None:
        raise UsageError("--figure shows how scores grow, and graphs from files tell no earlier ones", "leave it out")
    names, files = reasoner or [usual_reasoner(target)], out or []
    _check_several(names, files, figure, graphs)
    for file in files:
        check_file("--out", file, "reason.json")
    check_file("--figure", figure, "reason.png")
    given_graphs = None if graph is None else read_graphs(graph)
    judged: dict[str, Any] = {"given": given_graphs, "boxes": boxes, "what_if": what_if}
    asked = [
        ReasonEvaluation(name, images, build(config_class(name), config, set_ or [], {}), **judged) for name in names
    ]
    training = Dataset.open(decoders) if decoders else None
    with episode_progress("inferring") as progress:
        told = [printing.ToldGraphs(graphs) for _ in names]

        def keep(file: Path, judged: "Sequence[JudgedGraph]") -> None:
            for own, one in zip(told, judged, strict=True):
                own.keep(file, one)

        results = evaluate_models(target, asked, training, assets, seed, workers, progress, keep)
    given: dict[str, Any] = {"images": images, "seed": seed, "decoders": decoders, "graph": graph}
    given |= {} if boxes == "given" else {"boxes": boxes}
    given |= {} if what_if else {"no-what-if": True}
    for name, result in zip(names, results, strict=True):
        who = name if graph is None else None  # a graph from a file was inferred by somebody else
        result["command"] = _command_again("reason", dataset, set_, config, reasoner=who, **given)
    for file, result in zip(files, results, strict=False):
        write_result(file, result)
        say(f"wrote {file}")
    _warn_of(target, dict(zip(names, results, strict=True)))
    if figure is not None:
        _draw_images(figure, results[0])
    if json:
        print_json(results[0] if len(results) == 1 else {"results": results})
        return
    for name, result, own in zip(names, results, told, strict=True):
        if len(results) > 1:
            tell(f"{name}:")
        printing.reasoning(result, own.unjudged)


def _draw_images(file: Path, result: dict[str, Any]) -> None:
    """How scores grow with images, if there is any score."""
    from busybot.view.figures.curves import images_figure

    if any(value is not None for point in result["by_images"] for name, value in point.items() if name != "images"):
        say(f"wrote {images_figure(file, result)}")
    else:
        warn(f"{file} was not drawn: no score could be told after any number of images")


def _warn_of(dataset: "Dataset", results: dict[str, dict[str, Any]]) -> None:
    """Say what makes the figures say little, whatever they are."""
    from busybot.datasets.info import collect_command
    from busybot.datasets.summary import nothing_moved

    recorded, boards = len(dataset.finished()), dataset.info.boards
    if recorded < boards:
        rest = collect_command(dataset.path, dataset.info)
        warn(f"{recorded} of {boards} boards are recorded, of which this speaks; the others: {rest}")
    for name, result in results.items():
        if result["trained_on_dataset"]:
            what = f"{name} was trained on these very boards, or on others of their drawing"
            warn(f"{what}: what it is worth, boards of another seed tell")
    if nothing_moved(dataset):
        again = "record another dataset with busybot collect --policy learned"
        warn(f"no recorded action moved anything, so nothing shows what controls what; {again}")


def _check_several(names: list[str], files: list[Path], figure: Path | None, graphs: Path | None) -> None:
    """Refuse what would be said of one reasoner, and not of several."""
    if files and len(files) != len(names):
        what = (
            f"--out names {len(files)} file{'s' * (len(files) > 1)} for {len(names)} reasoner{'s' * (len(names) > 1)}"
        )
        raise UsageError(what, "give one --out for each --reasoner, in the same order")
    if len(set(files)) < len(files):
        raise UsageError("--out names a file twice", "give each --reasoner a file of its own")
    for option, value in (("--figure", figure), ("--graphs", graphs)):
        if len(names) > 1 and value is not None:
            raise UsageError(f"{option} is about one reasoner, {len(names)} are named", "judge them one by one")


@app.command()
def interact(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset; only its boards are used.")],
    model: Annotated[
        str | None,
        typer.Option(
            help="Shipped model (by default procedural) or folder; or random, scripted (an oracle).",
            autocompletion=offering(lambda: [*interaction_models(), *BUILT_IN]),
        ),
    ] = None,
    mode: Annotated[
        Literal["evaluate", "greedy", "ucb", "collect"] | None,
        typer.Option(help="How a model chooses: evaluate, greedy, ucb or collect; evaluate, for paper models ucb."),
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Only so many, the first ones; by default all.")] = None,
    strict: StrictOption = False,
    out: OutOption = None,
    record: Annotated[Path | None, typer.Option(help="Record the episodes as a dataset in this folder.")] = None,
    figures: Annotated[int, typer.Option(min=0, help="Draw so many of the recorded boards into OUT/figures.")] = 0,
    assets: AssetsOption = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of InteractEvaluation.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as learned.explore=0.5.")] = None,
    json: JsonOption = False,
) -> None:
    """How often actions succeed, and how many of the movable links they find: ten actions on each board.

    Shares in JSON lie between 0 and 1, in the table they are percent.
    """
    from busybot.common.config import build
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.interact.evaluate import InteractEvaluation, PolicyEvaluation, evaluate_policy

    _check_figures(figures, model, out, record)
    parameters = build(InteractEvaluation, config, set_ or [], {"boards": boards, "interaction.strict": strict or None})
    with episode_progress("acting") as progress:
        target = Dataset.open(dataset)
        library = library_of(target, assets)
        factory, provenance = _policy(model, mode, parameters.learned)
        evaluation = PolicyEvaluation(target, library, factory, parameters, seed, record, provenance)
        result = evaluate_policy(evaluation, processes(workers), progress, out)
    if figures and out is not None and record is not None:
        _draw_figures(out / "figures", record, model, parameters, figures)
    given = {"model": model, "mode": mode, "seed": seed, "strict": strict, "boards": boards}
    result["command"] = _command_again("interact", dataset, set_, config, **given)
    _write(out, result)
    if json:
        print_json(result)
    else:
        printing.interaction(result)


def _policy(model: str | None, mode: str | None, learned: dict[str, Any]) -> "tuple[AnyPolicyFactory, dict[str, Any]]":
    """What makes the policies of that name, and what it is made of."""
    from busybot.interact.policy.learned import mode_named
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, usual_mode
    from busybot.sim.builtin_policies import builtin_factory

    if model in BUILT_IN:
        if mode or learned:
            unused = f"--mode {mode}" if mode else f"--set learned.{next(iter(learned))}"
            raise UsageError(f"{unused} is about a trained model's policy, {model} has none", "leave it out")
        return builtin_factory(model), {"model": {"name": model}}
    named = model or DEFAULT_MODEL
    factory = LearnedPolicyFactory(named, mode_named(mode) if mode else usual_mode(named), learned)
    return factory, factory.provenance()


def _check_figures(figures: int, model: str | None, out: Path | None, record: Path | None) -> None:
    """Refuse figures that could not be drawn, before anything else is done."""
    if not figures:
        return
    if out is None or record is None:
        raise UsageError("--figures draws recorded boards into the results", "give --out and --record, too")
    if model in BUILT_IN:
        raise UsageError(f"--figures shows a model's affordances, {model} has none", "leave --figures out")


def _draw_figures(folder: Path, record: Path, model: str | None, config: "InteractEvaluation", count: int) -> None:
    """Affordances, known links and actions of the first recorded boards."""
    from busybot.datasets.dataset import Dataset
    from busybot.episodes.mcap.reader import read_episode
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL, load_once, policy_config
    from busybot.interact.policy.policy_trace import retrace
    from busybot.view.figures.sequences import affordance_figure

    dataset, loaded = Dataset.open(record), load_once(model or DEFAULT_MODEL)
    policy = policy_config(loaded.info, config.learned)
    for index in sorted(dataset.finished())[:count]:
        episode = read_episode(dataset.episode_path(index), "lazy")
        affordance_figure(folder / f"board-{index:06d}.png", episode, list(retrace(episode, loaded, policy)))


@app.command()
def plan(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with tasks and histories.")],
    agents: Annotated[
        str,
        typer.Option(
            help="Comma between them: noop, random, relation, predictive, busybot, search, oracle; mechanism, with a "
            "reasoner of that variant; trained ones with their folders: bc=DIR, ppo=DIR; told a part of the truth: "
            "search-true-relations, search-true-contacts, search-true-both.",
            show_default="all but mechanism that need no folder and are told nothing, and oracle",
        ),
    ] = "search,busybot,predictive,relation,random,noop,oracle",
    reasoner: Annotated[
        str | None,
        typer.Option(
            help="Who infers and predicts: lookup, or a trained reasoner.",
            autocompletion=offering(reasoners),
            show_default=USUAL_REASONER,
        ),
    ] = None,
    policy_model: Annotated[
        str | None,
        typer.Option(
            help="Interaction model that proposes candidates: a shipped one (by default procedural) or a folder.",
            autocompletion=offering(interaction_models),
        ),
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Only the first so many tasks; by default all.")] = None,
    out: OutOption = None,
    record: Annotated[
        Path | None, typer.Option(help="Record the rollouts in this folder: in it a dataset for every agent.")
    ] = None,
    assets: AssetsOption = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of PlanConfig.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as learned.caution=0.5.")] = None,
    json: JsonOption = False,
) -> None:
    """How often agents make a board look as its goal picture: at most eight steps on each task (--set steps=8).

    Shares in JSON lie between 0 and 1, in the table they are percent. CPU ms are those of a decision, the interaction
    model's part included, simulation and rendering left out.
    """
    from busybot.common.config import build
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL
    from busybot.plan.evaluate import PlanEvaluation, evaluate_agents, trained_elsewhere
    from busybot.plan.rollout import PlanConfig
    from busybot.reason.models.registry import usual_reasoner

    parameters = build(PlanConfig, config, set_ or [], {"boards": boards})
    names = list(dict.fromkeys(name.strip() for name in agents.split(",")))
    with episode_progress("planning") as progress:
        target = Dataset.open(dataset)
        library, proposer = library_of(target, assets), policy_model or DEFAULT_MODEL
        reasoner = reasoner or usual_reasoner(target)
        evaluation = PlanEvaluation(target, library, names, reasoner, proposer, parameters, seed, record)
        for sentence in trained_elsewhere(evaluation):
            say(sentence)
        result = evaluate_agents(evaluation, processes(workers), progress, out)
    given = {"agents": agents, "reasoner": reasoner, "policy-model": policy_model, "seed": seed, "boards": boards}
    result["command"] = _command_again("plan", dataset, set_, config, **given)
    _write(out, result)
    if json:
        print_json(result)
    else:
        printing.planning(result)


@app.command(name="what-if")
def what_if(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with episodes.")],
    questions: Annotated[
        Path | None, typer.Option(help="Write the questions with their answers into this file, a line of JSON each.")
    ] = None,
    answers: Annotated[Path | None, typer.Option(help="Judge the answers in this file of the same lines.")] = None,
    images: Annotated[int, typer.Option(min=2, help="Ask about the actions between so many images.")] = 23,
    out: Annotated[Path | None, typer.Option(help="Write the result of --answers as JSON to this file.")] = None,
    assets: AssetsOption = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """What had been otherwise without an action: paired questions for programs of your own, or their answers judged.

    They are the questions that `eval reason` asks its models. Needs recorded states, as simulated boards have them.
    """
    from busybot.common.atomic_io import write_atomically
    from busybot.datasets.dataset import Dataset
    from busybot.evaluation.results import write_result
    from busybot.reason.evaluation.questions import asked_about, judge_answers, lines, read_answers

    if (questions is None) == (answers is None):
        raise UsageError("what-if writes questions or judges answers", "give --questions FILE or --answers FILE")
    if out is not None and answers is None:
        raise UsageError("--out is about answers", "give --answers, too, or leave --out out")
    check_file("--questions", questions, "questions.jsonl")
    check_file("--out", out, "what-if.json")
    target, given = Dataset.open(dataset), None if answers is None else read_answers(answers)
    with episode_progress("asking") as progress:
        asked = asked_about(target, assets, images, processes(workers), progress)
    boards = len({one.board for one in asked})
    if questions is not None:
        write_atomically(questions, lines(asked).encode())
        facts = {"questions": len(asked), "boards": boards, "file": questions}
        answer(json, facts, f"wrote {questions}: {counted(len(asked), 'pair')} about {counted(boards, 'board')}")
        return
    assert given is not None
    result = judge_answers(target, asked, given, images, seed)
    result["command"] = _command_again("what-if", dataset, None, None, answers=answers, images=images, seed=seed)
    if out is not None:
        write_result(out, result)
        say(f"wrote {out}")
    if json:
        print_json(result)
    else:
        printing.answers(result)


def _write(folder: Path | None, result: dict[str, Any]) -> None:
    from busybot.evaluation.folder import RESULT
    from busybot.evaluation.results import write_result

    if folder is not None:
        write_result(folder / RESULT, result)


def _command_again(skill: str, dataset: Path, settings: list[str] | None, config: Path | None, **options: Any) -> str:
    """The command that gives the same result; options that are None or False were not given."""
    words = ["busybot", "eval", skill, str(dataset)]
    for name, value in options.items():
        if value is not None and value is not False:
            words += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    words += [word for setting in settings or [] for word in ("--set", setting)]
    return shlex.join([*words, *(["--config", str(config)] if config else [])])
