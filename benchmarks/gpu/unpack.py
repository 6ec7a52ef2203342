"""Makes an ordinary model folder of what came back from a machine with a GPU: the way back.

    python -m benchmarks.gpu.unpack --pack PACK --run RUN --out WORK/paper-0
    python -m benchmarks.gpu.unpack --run RUN --out MODEL

`busybot eval reason DATASET --reasoner WORK/paper-0` judges it like any other. If the schedule was done to its end, the
folder is that of `busybot train reason` with the same datasets, parameters and seed, and

    python -m benchmarks.tables.table2 --data DATA --work WORK --out FILE --rows paper

finds the row trained and judges it. A training that ended before is a model, but no row of the table. Interaction
networks, which learned from no pack, become a model for `busybot eval interact DATASET --model MODEL`. The card says on
which machine the networks were trained, for how many minutes, from which pack and by which code.
"""

import argparse
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from benchmarks import runner
from benchmarks.gpu.formats import METRICS, RUN, config_of, read_pack_info, read_run
from busybot.common.atomic_io import copy_file
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.interact.affordance.networks import KINDS
from busybot.interact.affordance.paper import PaperModel
from busybot.interact.policy.config import AffordanceInfo
from busybot.reason.models.paper.networks import network_of
from busybot.reason.models.registry import ReasonerInfo
from busybot.reason.train import plot
from busybot.training.checkpoint import network_with, save_model
from busybot.training.loop import files_of
from busybot.training.run_folder import begin_folder

NAME = "paper"


def unpack_interaction(run: Path, out: Path) -> AffordanceInfo:
    """Write the model folder of interaction networks; returns what its card says.

    Raises:
        BusybotError: the run is one of graph networks, its card is no such model's, or the folder exists.
    """
    told, tensors = read_run(run)
    if told.pack is not None:
        raise BusybotError(f"{run}: its networks learned from a pack", "name it: --pack PACK")
    if out.exists():
        raise BusybotError(f"{out}: it exists", "name another folder")
    elsewhere = {name: getattr(told, name) for name in ("machine", "versions", "commit", "schedule")}
    elsewhere |= {"minutes": round(told.seconds / 60, 2), "rounded_to_float16": told.half}
    training = dict(told.figures.get("training") or {}) | elsewhere | {"epochs": told.iterations}
    try:
        info = AffordanceInfo.model_validate({**told.figures, "training": training})
    except ValidationError as error:
        raise BusybotError(f"{run / RUN}: {first_fault(error)}", "bring it back again") from None
    if info.variant != NAME:
        raise BusybotError(f"{run / RUN}: networks of the variant {info.variant}, not {NAME}", "bring it back again")
    networks = {}
    for kind in KINDS:
        own = {name.removeprefix(f"{kind}/"): one for name, one in tensors.items() if name.startswith(f"{kind}/")}
        networks[kind] = network_with(partial(PaperModel.make_network, kind, info.inputs, own), own, run)
    PaperModel(info, networks).save(out)
    return info


def unpack(pack: Path, run: Path, out: Path) -> ReasonerInfo:
    """Write the folder; returns what the model's card says.

    Raises:
        BusybotError: the run is one of another pack, or the folder holds another training.
    """
    packed, digest = read_pack_info(pack)
    told, tensors = read_run(run)
    if told.pack is None:
        raise BusybotError(f"{run}: interaction networks, which learned from no pack", "leave --pack out")
    if told.pack != digest:
        raise BusybotError(f"{run}: it was trained on another pack than {pack}", "name the one that it was trained on")
    config = config_of(packed, told.row, run)
    network = network_with(lambda: network_of(config), tensors, run)
    if told.iterations == told.schedule:
        begin_folder(out, config, told.seed, data=packed.data)
    elif out.exists():
        raise BusybotError(f"{out}: it exists, and the training came to no end", "name another folder")
    copy_file(run / METRICS, files_of(out, NAME)[1])
    plot(out, NAME)
    info = ReasonerInfo(
        model="paper",
        encoder=config.encoder,
        config=config.model_dump(mode="json"),
        training={
            "seed": told.seed,
            "data": packed.data,
            "features": packed.features,
            "oracle": packed.oracle,
            "boards": packed.boards,
            "boards_held_out": 0,
            **told.figures,
            "schedule": told.schedule,
            "minutes": round(told.seconds / 60, 2),
            "pack_sha256": digest,
            "rounded_to_float16": told.half,
            "machine": told.machine,
            "versions": told.versions,
            "commit": told.commit or packed.commit,
        },
    )
    save_model(out / "model", info, network.state_dict())
    return info


def main(words: list[str]) -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument(
        "--pack", type=Path, help="folder of benchmarks.gpu.pack, whose JSON is enough; of graph networks"
    )
    options.add_argument("--run", type=Path, required=True, help="what benchmarks.gpu.train wrote for the way back")
    options.add_argument("--out", type=Path, required=True, help="folder of the model")
    arguments = options.parse_args(words)
    if arguments.pack is None:
        told = unpack_interaction(arguments.run, arguments.out).training
        print(f"{arguments.out}: {told['epochs']} of {told['schedule']} epochs, {told['minutes']} minutes")
        return
    info = unpack(arguments.pack, arguments.run, arguments.out)
    done = f"{info.training['iterations']} of {info.training['schedule']} iterations"
    print(f"{arguments.out}: {done}, {info.training['minutes']} minutes; busybot eval reason DATASET --reasoner it")


if __name__ == "__main__":
    runner.one_of(main)
