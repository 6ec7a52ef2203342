"""`python -m tools.screenshots`: pictures of the viewer, and of others' tools that show recordings, for the docs.

Real programs, nothing drawn after: busybot's view of a board of gates, Foxglove Studio 1.48 (the last open one, as npm
has it) with the layout of docs/reference, Rerun's viewer with a recording alone, and an exported table as `datasets`
loads and pandas prints it. The first needs nothing; the others need `make check-exports` (for the table), npm and
Chromium: `apt-get install npm chromium-headless-shell`.
"""

import argparse
import http.server
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

from PIL import Image

from benchmarks.runner import busybot
from busybot.view.viewer_process import save_screenshot

ROOT = Path(__file__).resolve().parents[1]
EPISODE = ROOT / "datasets" / "tiny" / "episodes" / "000003.mcap"
LAYOUT = ROOT / "docs" / "reference" / "foxglove-layout.json"
STUDIO = ("@foxglove/studio-base@1.48.0", "react@18.3.1", "react-dom@18.3.1")
PICTURES = {"viewer": "viewer.png"} | {one: f"opened-{one}.png" for one in ("foxglove", "rerun", "table")}
SECONDS = 25
"""That a page has for loading and drawing, without a graphics card."""
TABLE = """
import base64, io, sys
from datasets import load_dataset
rows = load_dataset(sys.argv[1], "learner", split="train").select(range(14, 19)).to_pandas()
def picture(one):
    return f'<img height=110 src="data:image;base64,{base64.b64encode(one["bytes"]).decode()}">'
rows = rows[["episode", "frame", "rgb", "depth", "pixel_u", "pixel_v", "direction", "changed_pixels", "reward"]]
table = rows.to_html(index=False, escape=False, border=0, formatters={"rgb": picture, "depth": picture})
rules = "body{font:15px sans-serif}td,th{padding:4px 14px;text-align:left;border-bottom:1px solid #ddd}"
print(f"<style>{rules}</style>{table}")
"""
PAGE = """<!doctype html><meta charset="utf-8"><style>html,body,#root{height:100%;margin:0}</style>
<img src="wait" hidden><div id="root"></div>
<script src="react/umd/react.production.min.js"></script>
<script src="react-dom/umd/react-dom.production.min.js"></script>
<script>
window.react = React; window["react-dom"] = ReactDOM; window.global = window;
localStorage.setItem("studio.profile-data", JSON.stringify(
  {currentLayoutId: "ours", onboarding: {settingsTooltipShownForPanelTypes: ["3D", "ImageViewPanel"]}}));
localStorage.setItem("fox.workspace", JSON.stringify({state: {sidebarItem: null}, version: 0}));
</script>
<script src="@foxglove/studio-base/assets/index.js"></script>
<script>
const settings = {colorScheme: "light"}, saved = {savedAt: "2026-01-01T00:00:00Z", data: LAYOUT};
const layouts = {ours: {id: "ours", name: "ours", permission: "CREATOR_WRITE", baseline: saved}};
const properties = {
  deepLinks: [`${location.origin}/?ds=remote-file&ds.url=${location.origin}/episode.mcap`],
  appConfiguration: {get: key => settings[key], set: async () => {}, addChangeListener() {}, removeChangeListener() {}},
  dataSources: [new RemoteDataSourceFactory()], extensionLoaders: [], enableGlobalCss: true,
  layoutStorage: {
    list: async () => Object.values(layouts), get: async (_, id) => layouts[id], importLayouts: async () => {},
    put: async (_, one) => layouts[one.id] = one, delete: async () => {},
  },
};
initI18n().then(() => ReactDOM.render(React.createElement(App, properties), document.getElementById("root")));
</script>
"""


class Pages(http.server.SimpleHTTPRequestHandler):
    """A folder with parts of files, and `wait`, an answer after which the browser thinks that the page is loaded."""

    def do_GET(self) -> None:  # noqa: N802, the base class calls it so
        span = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        if self.path.endswith("wait"):
            time.sleep(SECONDS)
        if not span:
            return super().do_GET()
        data = Path(self.translate_path(self.path)).read_bytes()
        first, last = int(span[1]), min(int(span[2] or len(data)), len(data) - 1)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
        self.send_header("Content-Length", str(last + 1 - first))
        self.end_headers()
        self.wfile.write(data[first : last + 1])

    def end_headers(self) -> None:
        self.send_header("Accept-Ranges", "bytes")
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Nothing is logged."""


def main() -> int:
    """Exit code 0, or an exception that says what is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--tools", type=Path, default=ROOT / ".tools", help="folder of the environments")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images", help="folder for the pictures")
    parser.add_argument("--only", choices=list(PICTURES), nargs="+", default=list(PICTURES))
    told = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for one in told.only:
            picture = told.out.absolute() / PICTURES[one]
            if one == "viewer":
                viewer(Path(name), picture)
            elif one == "foxglove":
                foxglove(told.tools.absolute() / "foxglove", picture)
            elif one == "rerun":
                save_screenshot(Path(shutil.copy(EPISODE, name)), picture, None)
            else:
                table(told.tools.absolute() / "tables", Path(name), picture)
            _smaller(picture)
            print(f"{picture}: {picture.stat().st_size // 1000} kB")
    return 0


def viewer(folder: Path, picture: Path) -> None:
    """A board of gates, and what the shipped `mechanism` model makes of it."""
    boards = f"{folder}/boards"
    busybot("generate", boards, "--world", "gates", "--boards", "1", "--split", "novel-config", "--seed", "5")
    busybot("collect", boards, "--policy", "scripted")
    busybot("view", boards, "--reasoner", "mechanism", "--screenshot", str(picture))


def foxglove(place: Path, picture: Path) -> None:
    """A recording from its start, in the layout as it stands."""
    place.mkdir(parents=True, exist_ok=True)
    if not (place / "node_modules" / "@foxglove").is_dir():
        words = ["npm", "install", "--silent", "--ignore-scripts", "--no-audit", "--no-fund", "--legacy-peer-deps"]
        subprocess.run([*words, *STUDIO], cwd=place, check=True)
    served = place / "node_modules"
    shutil.copyfile(EPISODE, served / "episode.mcap")
    (served / "index.html").write_text(PAGE.replace("LAYOUT", LAYOUT.read_text()))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Pages, directory=str(served))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        shoot(f"http://127.0.0.1:{server.server_port}/index.html", picture, (1600, 900))
        server.shutdown()


def table(environment: Path, folder: Path, picture: Path) -> None:
    """Five rows of the export for Hugging Face's library."""
    busybot("dataset", "export", str(EPISODE.parents[1]), "--to", "hf", "--out", f"{folder}/hf")
    command = [str(environment / "bin" / "python"), "-c", TABLE, f"{folder}/hf"]
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder), "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"}
    html = subprocess.run(command, env=offline, check=True, capture_output=True, text=True).stdout
    (folder / "table.html").write_text(html)
    shoot((folder / "table.html").as_uri(), picture, (1130, 670))


def shoot(address: str, picture: Path, size: tuple[int, int]) -> None:
    """A PNG of a page once it is loaded."""
    browser = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if browser is None:
        raise SystemExit("Chromium is missing: apt-get install chromium-headless-shell")
    words = ["--headless", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--timeout=90000"]
    words += [f"--window-size={size[0]},{size[1]}", f"--screenshot={picture}", address]
    subprocess.run([browser, *words], check=True, capture_output=True, timeout=120)


def _smaller(picture: Path) -> None:
    """1200 pixels wide at most."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail((1200, 1200), Image.Resampling.LANCZOS)
    image.save(picture, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
