"""Puts `datasets/tiny` into the package as `busybot/datasets/tiny`; all else stands in pyproject.toml."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class _WithTiny(build_py):
    def run(self) -> None:
        super().run()
        if not self.editable_mode:  # there it lies beside the package
            shutil.copytree("datasets/tiny", Path(self.build_lib, "busybot/datasets/tiny"), dirs_exist_ok=True)


setup(cmdclass={"build_py": _WithTiny})
