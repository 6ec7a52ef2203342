"""`make check-loader`: the example of Rerun's catalogue and PyTorch in docs/guides/look.md, run as it stands.

It needs packages that the project does not have (requirements/loader.txt); they stand in an environment of their own,
`.tools/loader` (provision/extras.py), which borrows all others from `.venv`. There PyTorch may be a CPU build, with
which torchvision's compiled operators do not load: they are declared, and the loader uses none of them.
"""

import argparse
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "guides" / "look.md"
BEFORE = """
import runpy, sys
import torch
if torch.__version__.endswith("+cpu"):
    operators = torch.library.Library("torchvision", "DEF")
    for name in ("nms", "qnms"):
        operators.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
runpy.run_path("example.py", run_name="__main__")
"""


def main() -> int:
    """The example's exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--tools", type=Path, default=ROOT / ".tools", help="folder of the environments")
    told = parser.parse_args()
    python = told.tools.absolute() / "loader" / "bin" / "python"
    (example,) = [
        code
        for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
        if "rerun.experimental" in code
    ]
    borrowed = os.pathsep.join([str(ROOT), sysconfig.get_path("purelib")])
    environment = {**os.environ, "PYTHONPATH": borrowed, "RERUN_TELEMETRY": "0"}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "example.py").write_text(example)
        done = subprocess.run([str(python), "-c", BEFORE], cwd=folder, env=environment)
    if done.returncode == 0:
        print("the example of docs/guides/look.md ran as it stands: Rerun's loader gave the frames that were recorded")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
