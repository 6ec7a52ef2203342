"""The figure of robustness, from the result of `benchmarks/reason_robustness.py`.

python -m benchmarks.robustness_figure benchmarks/results/reason_robustness.json F.png
"""

import argparse
import json
from pathlib import Path

from busybot.view.robustness_figure import robustness_figure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path)
    parser.add_argument("figure", type=Path)
    arguments = parser.parse_args()
    print(robustness_figure(arguments.figure, json.loads(arguments.result.read_text())))
