"""What a release publishes, written into build/release: wheel, source archive, site, data, conda recipe, notes.

    python scripts/release.py --address https://...   # of a clean checkout; a person publishes the folder
    python scripts/release.py --dry                   # also without an address or with changes, which it leaves out

The address is the repository's; packages, CITATION.cff and codemeta.json of the source archive have it and its issues,
and pages of lessons the links by which Binder starts them.

The version is a file's, setup.cfg, and not a tag's: an archive without a repository builds the same package. A wheel
made here bears the commit. `nox -s release` runs the checks before.
"""

import argparse
import configparser
import gzip
import hashlib
import io
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from urllib.parse import quote

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from refsim.core.streams import any_letter  # noqa: E402
from refsim.core.writing import write_file  # noqa: E402

FOLDER = ROOT / "build" / "release"
STORED = ("figures/*.json*", "refsim/study/panels/*.json", "validation/data/*", "validation/papers/*")
RECIPE = """\
# rattler-build build --recipe recipe.yaml
schema_version: 1
package:
  name: refsim
  version: "{version}"
source:
  url: https://pypi.org/packages/source/r/refsim/refsim-{version}.tar.gz
  sha256: {digest}
build:
  noarch: python
  script: python -m pip install . --no-deps --no-build-isolation
requirements:
  host:
    - python >=3.11
    - pip
    - setuptools >=77
  run:
    - python >=3.11
{packages}
tests:
  - python:
      imports: [refsim]
  - script: [refsim --version]
about:
  summary: {summary}
  license: MIT
  license_file: LICENSE
"""


def run(*command: str) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def notes(version: str) -> str:
    """The changelog's part of a version; that of "Unreleased" where it has none yet."""
    parts = dict(
        re.findall(r"^## (\S+)[^\n]*\n(.*?)(?=^## |\Z)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M | re.S)
    )
    return parts.get("Unreleased", parts[version]).strip() + "\n"


def data(version: str) -> Path:
    """The stored results, one archive whose bytes follow from their contents."""
    made = FOLDER / f"refsim-data-{version}.tar.gz"
    whole = io.BytesIO()
    with (
        gzip.GzipFile("", "wb", fileobj=whole, mtime=0) as packed,
        tarfile.TarFile(fileobj=packed, mode="w") as archive,
    ):
        for path in sorted(path for pattern in STORED for path in ROOT.glob(pattern) if path.is_file()):
            archive.add(path, f"refsim-data-{version}/{path.relative_to(ROOT)}", filter=_anonymous)
    write_file(made, whole.getvalue())
    return made


def _anonymous(member: tarfile.TarInfo) -> tarfile.TarInfo:
    member.mtime, member.uid, member.gid, member.uname, member.gname, member.mode = 0, 0, 0, "", "", 0o644
    return member


ADDRESSED = {  # file: (line that the addresses follow, lines with them)
    "setup.cfg": ("project_urls =\n", "    Source = {0}\n    Issues = {0}/issues\n"),
    "CITATION.cff": ("type: software\n", "repository-code: {0}\n"),
    "codemeta.json": ('"name": "refsim",\n', '  "codeRepository": "{0}",\n  "issueTracker": "{0}/issues",\n'),
}


def fill_in(folder: Path, address: str) -> None:
    """Write the repository's address into a checkout."""
    for name, (line, lines) in ADDRESSED.items():
        before, separator, after = (folder / name).read_text("utf-8").partition(line)
        if not separator:
            raise ValueError(f"{name} lacks the line {line.strip()!r}")
        write_file(folder / name, before + line + lines.format(address.rstrip("/")) + after)


def binder(address: str, notebook: str) -> str:
    """The link by which Binder starts a notebook of this version, given as a path in the repository at the address."""
    settings, address = configparser.ConfigParser(interpolation=None), address.rstrip("/")
    settings.read(ROOT / "setup.cfg", encoding="utf-8")
    host, _, path = address.removeprefix("https://").partition("/")
    hosted = {"github.com": f"gh/{path}", "gitlab.com": f"gl/{quote(path, safe='')}"}
    place = hosted.get(host, f"git/{quote(address, safe='')}")
    return f"https://mybinder.org/v2/{place}/v{settings['metadata']['version']}?urlpath=lab/tree/{notebook}"


def release(dry: bool, address: str) -> int:
    settings = configparser.ConfigParser(interpolation=None)
    settings.read(ROOT / "setup.cfg", encoding="utf-8")
    version, commit = settings["metadata"]["version"], run("git", "rev-parse", "HEAD")
    if changed := run("git", "status", "--porcelain"):
        print(f"The checkout has changes; commit or remove them:\n{changed}")
        if not dry:
            return 2
    if not (dry or address):
        print("A release needs the repository's address: --address https://...")
        return 2
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as copy:
        run("git", "clone", "-q", str(ROOT), copy)
        write_file(Path(copy, "refsim", "commit.txt"), f"{commit}\n")
        if address:
            fill_in(Path(copy), address)
        run(sys.executable, "-m", "build", "-o", str(FOLDER), copy)
    site = ("-W", "-q", "-b", "html", "-D", f"repository={address}", "docs", str(FOLDER / "site"))
    run(sys.executable, "-m", "sphinx", *site)
    source = FOLDER / f"refsim-{version}.tar.gz"
    packages = "\n".join(f"    - {name}" for name in settings["options"]["install_requires"].split())
    recipe = RECIPE.format(
        version=version, digest=digest(source), packages=packages, summary=settings["metadata"]["description"]
    )
    write_file(FOLDER / "recipe.yaml", recipe)
    write_file(FOLDER / "notes.md", notes(version))
    shutil.make_archive(str(FOLDER / f"refsim-site-{version}"), "gztar", FOLDER, "site")
    data(version)
    print(f"refsim {version}, commit {commit}, in {FOLDER.relative_to(ROOT)}:")
    for path in sorted(path for path in FOLDER.iterdir() if path.is_file()):
        print(f"  {path.name:<40} {path.stat().st_size / 1e6:8.2f} MB  sha256 {digest(path)[:16]}")
    print(
        f"To publish: git tag v{version} {commit[:10]}; twine upload the wheel and the source archive; attach the rest."
    )
    return 0


@any_letter()
def main() -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--dry", action="store_true", help="also without an address or with changes, which are left out"
    )
    parser.add_argument("--address", default="", help="of the repository, https://...")
    options = parser.parse_args()
    return release(options.dry, options.address)


if __name__ == "__main__":
    sys.exit(main())
