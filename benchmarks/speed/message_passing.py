"""Measures the gain of multiplying nodes before they are joined to edges, in the paper's training of relations.

    python -m benchmarks.speed.message_passing [--iterations 3] [--boards 8] [--out FILE]

The edge functions of the paper's networks have two forms that compute the same (`parts.EdgeFunction`): the one that the
paper writes, and a factored one. Iterations of both take turns on made-up boards of the paper's size; what is reported
is the least processor time of one and their ratio. The factored form is worth having if it is 1.5 times as fast for the
paper's graph, which connects all pairs; it then serves the smaller graph, too.
"""

import json
import time
from typing import Any, Literal

import torch

from benchmarks.runner import finish, parser
from benchmarks.speed.paper_reason import made_up
from busybot.common.rng import generator
from busybot.reason.models.paper.config import PaperNetworkConfig, PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import iterate, make_network, make_optimizer
from busybot.reason.models.paper.parts import factor
from busybot.training.run_folder import learner_versions

GATE = 1.5
"""Least ratio for which a second form is worth having."""
PAIRS: tuple[Literal["all", "candidates"], ...] = ("all", "candidates")
FORMS = {"joined": False, "factored": True}


def measure(
    pairs: Literal["all", "candidates"], boards: int, iterations: int, inference: bool = True
) -> dict[str, Any]:
    """Processor seconds of an iteration in each form, and how many times as fast the factored one is."""
    config = PaperReasonConfig(network=PaperNetworkConfig(pairs=pairs))
    rng = generator(0, "", 0, "made-up boards")
    batch = boards_of([made_up(rng) for _ in range(boards)], config.network)
    networks = {form: make_network(config, 0) for form in FORMS}
    optimizers = {form: make_optimizer(network, config) for form, network in networks.items()}
    seconds: dict[str, list[float]] = {form: [] for form in FORMS}
    for number in range(iterations + 1):
        for form, network in networks.items():
            factor(network, FORMS[form])
            began = time.process_time()
            iterate(network, optimizers[form], batch, config, generator(0, "", number, "benchmark"))
            seconds[form].append(time.process_time() - began)
    least = {form: min(times[1:]) for form, times in seconds.items()}  # whatever else the machine does only adds to it
    ratio = least["joined"] / least["factored"]
    return {
        "edges": batch.edge_index.shape[1],
        **{f"{form}_cpu_seconds": round(each, 3) for form, each in least.items()},
        "ratio": round(ratio, 2),
        "reached": ratio >= GATE,
    }


def main() -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--iterations", type=int, default=3, help="of each form, after one that does not count")
    options.add_argument("--boards", type=int, default=8, help="per iteration")
    arguments = options.parse_args()
    torch.set_num_threads(1)
    pairs = {name: measure(name, arguments.boards, arguments.iterations) for name in PAIRS}
    figures = {"gate_ratio": GATE, "pairs": pairs}
    result = finish("message-passing", arguments, figures, learner_versions(), machine={"threads": 1})
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
