"""How a learned agent does on explored boards while it is trained."""

from collections.abc import Sequence

from busybot.plan.learned.explored import Explored
from busybot.plan.learned.network import PolicyNetwork, play

SHOWN = 64
"""So many of the boards that are trained on are judged."""


def success_of(network: PolicyNetwork, boards: Sequence[Explored], held_out: Sequence[Explored]) -> dict[str, float]:
    """Mean success at the end of a task, on boards that are trained on and on those that are held out."""
    network.eval()
    found = {"success_seen": float(play(network, boards[:SHOWN]).mean())}
    return found | ({"success": float(play(network, held_out).mean())} if held_out else {})
