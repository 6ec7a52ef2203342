"""The demo's report: one board's story in Markdown, with the figures beside it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.boards.spec import BoardSpec
from busybot.episodes.dataset_info import DatasetInfo
from busybot.episodes.episode import Episode
from busybot.plan.notes import reason
from busybot.reason.result import InferredGraph
from busybot.view.scene import judged_edges, named, object_names

KINDS = {
    "one-to-one": "one switch, one effect",
    "one-to-many-effects": "a lever with three positions, one effect for each",
    "one-to-many-objects": "a panel, one effect for each of its buttons",
}

REASONERS = {
    "event": "The model `event` sees the pictures, the objects' boxes and roles, and the actions. It never sees the "
    "simulator's relations or states. It compares how each responder looks before and after every action, and learned "
    "on other boards what that tells about which trigger controls it.",
}
"""How the graph was inferred, by the reasoner's name."""


@dataclass(frozen=True)
class Story:
    """What the report tells.

    Attributes:
        chosen: index of the episode that is shown in detail.
        result: of `reason.evaluate.evaluate_dataset`.
        pictures: by name.
        early: the step of the early picture of the viewer.
        rollout: of the agent that reaches for a goal.
        planned: what `plan.evaluate.evaluate` tells of this agent.
    """

    episodes: list[Episode]
    chosen: int
    inferred: InferredGraph
    result: dict[str, Any]
    info: DatasetInfo
    recording: Path
    pictures: dict[str, Path]
    early: int
    rollout: Episode
    planned: dict[str, Any]


def demo_report(story: Story, folder: Path) -> str:
    """The report's text; links are relative to `folder`."""
    parts = (_boards, _actions, _relations, _refinement, _numbers, _goal, _next)
    text = "\n\n".join(part(story, folder) for part in parts)
    return f"# A switch, a lamp, and what connects them\n\n{text}\n"


def _picture(story: Story, folder: Path, name: str, caption: str) -> str:
    return f"![{caption}]({story.pictures[name].relative_to(folder).as_posix()})\n\n*{caption}*"


def _boards(story: Story, folder: Path) -> str:
    return (
        "## The boards\n\nA BusyBoard carries triggers (switches, levers, panels) and responders (lamps, doors, "
        f"toys). Hidden relations connect them. These {len(story.episodes)} were drawn with seed {story.info.seed} "
        f"from {story.info.assets.name} objects.\n\n"
        + _picture(
            story, folder, "boards", f"The boards before anybody acts; board {story.chosen}, told of below, with names."
        )
    )


def _actions(story: Story, folder: Path) -> str:
    episode = story.episodes[story.chosen]
    moved = sum(step.success for step in episode.steps)
    return (
        "## Acting\n\nWhere can something be moved, and in which direction? The policy learned it from depth images "
        "and from pixels that change, without labels, and has not seen these boards before. It chooses at random among "
        "what looks movable, first what it has not tried: a point to take hold of and one of 18 directions. On board "
        f"{story.chosen} it acted {len(episode.steps)} times and moved a trigger {moved} times. The reward is 1 when "
        "more than "
        f"{episode.settings.get('interaction', {}).get('delta', 500)} pixels change.\n\n"
        + _picture(
            story, folder, "affordance", "What the policy believed before its first actions: affordance in orange."
        )
        + "\n\n"
        + _picture(story, folder, "episode", "Some actions and what they changed.")
        + "\n\n"
        + _picture(story, folder, "changes", "Changed pixels of every action, and the threshold of the reward.")
    )


def _relations(story: Story, folder: Path) -> str:
    board = story.episodes[story.chosen].board
    return (
        f"## What controls what\n\n{REASONERS[story.inferred.name]}\n\n"
        + _picture(story, folder, "graph", "The inferred scene graph over the board.")
        + "\n\n"
        + _relation_table(board, story.inferred)
    )


def _relation_table(board: BoardSpec, inferred: InferredGraph) -> str:
    names = object_names(board)
    kinds = {
        (ref.object, relation.responder): relation.kind for relation in board.relations for ref in relation.triggers
    }
    probabilities = inferred.after(len(inferred.probabilities))
    lines = ["| trigger | responder | probability | verdict | kind |", "|---|---|---|---|---|"]
    for edge in judged_edges(board, inferred, len(inferred.probabilities)):
        pair = (edge.cause, edge.effect)
        kind = KINDS.get(kinds.get(pair, ""), "")
        chance = f"{probabilities[pair]:.3f}"
        lines.append(f"| {names[edge.cause]} | {names[edge.effect]} | {chance} | {edge.verdict} | {kind} |")
    return "\n".join(lines)


def _refinement(story: Story, folder: Path) -> str:
    return (
        "## How certainty grows\n\n"
        + _picture(story, folder, "refinement", "Probabilities after more and more steps; true relations are framed.")
        + f"\n\nThe viewer after {story.early} steps, and at the end:\n\n"
        + _picture(story, folder, f"viewer_{story.early}", f"Rerun after {story.early} steps.")
        + "\n\n"
        + _picture(story, folder, f"viewer_{len(story.inferred.probabilities)}", "Rerun at the end.")
    )


def _numbers(story: Story, folder: Path) -> str:
    result, baselines = story.result, story.result["baselines"]
    rows = [
        ("the model that comes with busybot", result),
        *((name.replace("_", " "), values) for name, values in baselines.items()),
    ]
    lines = [
        "## The numbers",
        "",
        f"Over all {result['boards']} boards, from their first {result['images']} images; percent. Four boards are a "
        "picture, not a result. More of them:",
        "",
        "```sh",
        "busybot generate more --boards 100 && busybot collect more && busybot eval reason more",
        "```",
        "",
        "Edge-P is the share of the claimed relations that are true, Edge-R the share of the true relations that were "
        "claimed, Edge-Acc the share of all pairs of a trigger and a responder that were judged rightly. The empty "
        "graph claims no relation, the all-ones graph every pair, and the random trigger one trigger, drawn by chance, "
        "for each responder.",
        "",
        "| | Edge-P | Edge-R | Edge-Acc |",
        "|---|---|---|---|",
        *(
            f"| {name} | {_percent(values['edge_p'])} | {_percent(values['edge_r'])} | {_percent(values['edge_acc'])} |"
            for name, values in rows
        ),
        "",
        f"Relations whose effect was visible at all: {_percent(result['edge_r_bound'])} %. Of the "
        f"{result['predicted_steps']} later steps, all responders looked as predicted after "
        f"{_percent(result['pred_a'])} %; whoever predicts no change: {_percent(result['persistence']['pred_a'])} %.",
    ]
    return "\n".join(lines)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"


def _goal(story: Story, folder: Path) -> str:
    rollout, planned = story.rollout, story.planned
    said = [named(rollout.board, reason(rollout, step)) for step in range(len(rollout.steps) + 1)]
    return (
        "## Reaching a goal\n\nAnother board comes with a picture of a goal. The policy acts on it as on the others; "
        f"from what that changed, `{rollout.policy}` knows which trigger to move, and which way. It compares "
        "the board with the goal after every action, and stops when nothing differs. At the end "
        f"{_percent(planned['success'])} % of the responders that some trigger controls were in their goal state.\n\n"
        + _picture(story, folder, "sequence", "From the start, action by action, to the goal at the right.")
        + "\n\nWhat it said:\n\n"
        + "\n".join(f"{number}. {words}" for number, words in enumerate(filter(None, said), start=1))
    )


def _next(story: Story, folder: Path) -> str:
    recording = story.recording.relative_to(folder).as_posix()
    hashes = story.result["dataset"]
    return (
        "## Look further\n\n"
        f"- `busybot view boards --episode {story.chosen}` opens the episode in Rerun; `{recording}` "
        "is the same as a file.\n"
        "- `busybot dataset info boards` tells what was recorded, `busybot dataset verify boards` checks it.\n"
        "- `busybot eval reason boards` repeats the inference; `relations.json` holds its result.\n"
        "- `busybot view rollouts/search` shows what the agent could choose from on its way to the goal; "
        "`busybot eval plan task --agents search,random` plays the task again.\n\n"
        f"Board hash `{hashes['board_hash'][:16]}`, trace hash `{hashes['trace_hash'][:16]}`, "
        f"content hash `{hashes['content_hash'][:16]}`: the same seed on the same machine gives the same three."
    )
