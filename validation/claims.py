"""What the papers claim, and what was measured of it: `python -m validation.claims [CLAIM ...]`.

The claims stand in `claims.toml`, one table each: the source's sentence in translation, where it stands, the test that
measures it, the bar, and what was measured. The tests stand with their system, in `validation/cases/<case>/claims.py`,
and are found there. A claim is confirmed if every start keeps the bar, and refuted otherwise; one that cannot be
measured is not testable, with its reason. Without `--write` the command measures anew what is not stored, and says
whether the written verdicts still hold.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import json
import math
import multiprocessing
import os
import pkgutil
import re
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError, RefsimError, RunStopped
from validation import cases as case_folder
from validation.harness import EXIT_FAILED, EXIT_FINE, Options, Results, Run, about_run, interrupted, machine
from validation.results import Result, finite, load, result_folder, save
from validation.running import Context
from validation.tables import Table
from validation.verdicts import RULES, number

ROOT = Path(__file__).resolve().parent.parent
FILE = Path(__file__).parent / "claims.toml"
PAGE = ROOT / "docs" / "claims.md"
CONFIRMED, REFUTED, NOT_TESTABLE = "confirmed", "refuted", "not testable"
_WANTED = {"system", "says", "where", "verdict"}
_MEASURED = {"test", "what", "unit", "measured", "spread", "starts"}


@dataclass(frozen=True)
class Claim:
    """One claim, as it stands in `claims.toml`.

    says      the source's sentence in translation, or what it amounts to; where: section, equation or figure
    test      "path/of/module.py:NAME" of the `Measure`
    what      the quantity in words, with its unit
    rule      at_most, at_least or equals; bound: its number
    measured  median over the starts (seeds, sizes, states); spread: least and largest; starts: how many
    reason    why it cannot be tested; of the others, what a reader must know beside the number
    """

    name: str
    system: str
    says: str
    where: str
    verdict: str
    test: str = ""
    what: str = ""
    unit: str = "-"
    rule: str = ""
    bound: float = math.nan
    measured: float = math.nan
    spread: tuple[float, float] = (math.nan, math.nan)
    starts: int = 0
    reason: str = ""

    def keeps(self, value: float) -> bool:
        """Whether a value keeps the bar; NaN does not."""
        return bool(RULES[self.rule][0](value, self.bound))

    def bar(self) -> str:
        """The bar in words."""
        return f"{RULES[self.rule][1]} {number(self.bound)}" if self.rule else ""

    def judge(self, values: Sequence[float]) -> str:
        """Confirmed if every start keeps the bar."""
        return CONFIRMED if values and all(map(self.keeps, values)) else REFUTED


@dataclass(frozen=True)
class Measure:
    """How a claim is measured: runs whose results are stored, and the values that follow, one for each start.

    quick  whether the quick sizes can judge it
    timed  its runs are timed: they run alone, on all threads, after the others
    """

    runs: Callable[[Options], Sequence[Run]]
    values: Callable[[Results], Sequence[float]]
    quick: bool = True
    timed: bool = False


@dataclass
class Found:
    """What was measured of a claim now, and where; `missing` says why nothing was."""

    claim: Claim
    values: list[float] = field(default_factory=list)
    missing: str = ""
    machine: Mapping[str, Any] = field(default_factory=machine)

    @property
    def verdict(self) -> str:
        """By the values; "" where there are none."""
        return self.claim.judge(self.values) if self.values else ""

    @property
    def holds(self) -> bool:
        """Whether what was measured says what is written; true where nothing was measured."""
        return not self.values or self.verdict == self.claim.verdict


def read_claims(path: Path = FILE) -> dict[str, Claim]:
    """The claims by name. Raises ValueError for a file that does not say what it must."""
    claims = {}
    for name, entry in tomllib.loads(path.read_text()).items():
        rules = [rule for rule in RULES if rule in entry]
        wanted = _WANTED if entry.get("verdict") == NOT_TESTABLE else _WANTED | _MEASURED
        lacking = wanted - set(entry)
        unknown = set(entry) - _WANTED - _MEASURED - set(RULES) - {"reason"}
        if lacking or unknown:
            raise ValueError(f"{path}: [{name}] lacks {sorted(lacking)} or has unknown keys {sorted(unknown)}")
        if entry["verdict"] not in (CONFIRMED, REFUTED, NOT_TESTABLE):
            raise ValueError(f"{path}: [{name}] has the verdict {entry['verdict']!r}")
        testable = entry["verdict"] != NOT_TESTABLE
        if len(rules) != testable or not (testable or entry.get("reason")):
            raise ValueError(f"{path}: [{name}] needs one rule, or a reason why it cannot be tested")
        given = {key: value for key, value in entry.items() if key not in RULES}
        if testable:
            given |= {"rule": rules[0], "bound": entry[rules[0]], "spread": tuple(entry["spread"])}
        claims[name] = Claim(name=name, **given)
    return claims


@functools.cache
def discover() -> dict[str, Measure]:
    """Every `Measure` of the modules `validation.cases.<case>.claims`, by "path/of/module.py:NAME"."""
    found = {}
    for entry in pkgutil.iter_modules(case_folder.__path__):
        name = f"{case_folder.__name__}.{entry.name}.claims"
        if entry.ispkg and importlib.util.find_spec(name):
            module = importlib.import_module(name)
            path = Path(str(module.__file__)).resolve().relative_to(ROOT).as_posix()
            found |= {f"{path}:{key}": value for key, value in vars(module).items() if isinstance(value, Measure)}
    return found


def case_of(test: str) -> str:
    """The case in whose folder a test stands."""
    return test.split("/")[2]


def measure(claims: Sequence[Claim], options: Options, jobs: int = 1, compute: bool = True) -> list[Found]:
    """Values of the claims; what is not stored is computed, in `jobs` processes, or left out."""
    measures, wanted = discover(), []
    waiting: dict[Path, Run] = {}
    timed: dict[Path, Run] = {}
    for claim in claims:
        found = Found(claim)
        wanted.append((found, {}))
        if claim.verdict == NOT_TESTABLE:
            found.missing = claim.reason
            continue
        if options.quick and not measures[claim.test].quick:
            found.missing = "takes the published sizes; run without --quick"
            continue
        for run in measures[claim.test].runs(options):
            folder = result_folder(options.results, case_of(claim.test), run.key, run.function, run.parameters)
            wanted[-1][1][run.key] = folder
            kept = (run.skip or not options.fresh) and load(folder) is not None  # perhaps from a machine that can
            if not kept and run.skip:
                found.missing = run.skip
            elif not kept:
                (timed if measures[claim.test].timed else waiting)[folder] = run
    if compute:
        _compute({folder: run for folder, run in waiting.items() if folder not in timed}, jobs)
        _compute(timed, 1)
    for found, folders in wanted:
        if found.missing:
            continue
        stored = {key: load(folder) for key, folder in folders.items()}
        results = {key: result for key, result in stored.items() if result is not None}
        if not compute and len(results) < len(stored):
            found.missing = "not measured here"
            continue
        found.values = [float(value) for value in measures[found.claim.test].values(results)]
        found.machine = next((r.about["machine"] for r in results.values() if "machine" in r.about), machine())
    return [found for found, _ in wanted]


def _compute(waiting: Mapping[Path, Run], jobs: int) -> None:
    """Compute and store; long runs first, one thread each where there are several processes."""
    from tqdm import tqdm

    order = sorted(waiting.items(), key=lambda item: -item[1].estimate)
    with tqdm(total=len(order), disable=not order, file=sys.stderr, desc="claims", unit="run") as bar:
        if jobs <= 1:
            for folder, run in order:
                try:
                    _one(folder, run)
                except KeyboardInterrupt:
                    raise interrupted(bar.n, folder.parent.parent) from None
                bar.update()
            return
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_one_thread) as pool:
            started = [pool.submit(_one, folder, run, 1) for folder, run in order]
            try:
                for done in as_completed(started):
                    done.result()
                    bar.update()
            except KeyboardInterrupt:
                pool.shutdown(wait=True, cancel_futures=True)
                raise interrupted(bar.n, order[0][0].parent.parent) from None


def _one_thread() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without words; the parent says what is kept
    os.environ["NUMBA_NUM_THREADS"] = "1"  # before Numba is loaded


def _one(folder: Path, run: Run, threads: int | None = None) -> None:
    context, began = Context(threads=threads), time.perf_counter()
    try:
        result = run.function(context, **run.parameters)
    except RunStopped as error:
        print(f"{folder.name} stopped. {error} (reason: {error.reason})", file=sys.stderr)
        return
    about = about_run(folder.parent.name, run, time.perf_counter() - began, context)
    save(folder, Result(result.values, result.arrays, about))


# Reports


def table(found: Sequence[Found]) -> Table:
    """What is written, and beside it what was measured now."""
    rows, last = [], ""
    for each in found:
        claim = each.claim
        now = spread_words(each.values) if each.values else "-"
        mark = "" if each.holds else f"  now {each.verdict}"
        what = claim.what or claim.says
        then = written(claim) if claim.starts else "-"
        rows.append([claim.system if claim.system != last else "", claim.name, what, claim.bar(), then, now,
                     claim.verdict + mark])  # fmt: skip
        last = claim.system
    heading = ["system", "claim", "quantity", "bar", "written", "measured now", "verdict"]
    return Table("Claims of the papers: median (least to largest)", heading, rows)


def spread_words(values: Sequence[float]) -> str:
    """Median and range of some values."""
    ordered = sorted(values)
    low, high = ordered[0], ordered[-1]
    middle = _median(ordered)
    said = ["infinite" if math.isinf(value) else number(value) for value in (middle, low, high)]
    if low == high:
        return said[0]
    return f"{said[0]} ({said[1]} to {said[2]})"


def _median(values: Sequence[float]) -> float:
    if any(not math.isfinite(value) for value in values):
        ordered = sorted(values, key=lambda value: (math.isnan(value), value))
        return ordered[len(ordered) // 2]
    ordered = sorted(values)
    half = len(ordered) // 2
    return ordered[half] if len(ordered) % 2 else 0.5 * (ordered[half - 1] + ordered[half])


def page_table(claims: Mapping[str, Claim], system: str) -> str:
    """The claims of a system as they stand on the page: a table, then each with its source's words."""
    own = [claim for claim in claims.values() if claim.system == system]
    lines = ["| claim | where | measured | confirmed by | verdict |", "| --- | --- | --- | --- | --- |"]
    for claim in own:
        values = written(claim) if claim.starts else ""
        cells = [f"[`{claim.name}`](#{anchor(claim)})", claim.where, values, claim.bar(), claim.verdict]
        lines.append(f"| {' | '.join(cells)} |")
    for claim in own:
        lines += ["", f"### {heading(claim)}", "", f"> {claim.says} ({claim.where})", ""]
        if claim.starts:
            lines += [
                f"{claim.what[0].upper()}{claim.what[1:]}: **{written(claim)}** over {claim.starts}"
                f" start{'s' * (claim.starts > 1)}; confirmed by {claim.bar()}. Test: `{claim.test}`.",
            ]
        if claim.reason:
            lines += [""] * bool(claim.starts) + [claim.reason]
    return "\n".join(lines)


def written(claim: Claim) -> str:
    """Median and range as they are written, with their unit."""
    unit = "" if claim.unit == "-" else f" {claim.unit}"
    return spread_words([claim.spread[0], claim.measured, claim.spread[1]]) + unit


def heading(claim: Claim) -> str:
    """Heading of a claim on the page."""
    return f"`{claim.name}`: {claim.verdict}"


def anchor(claim: Claim) -> str:
    """What its heading is called in links."""
    return f"{claim.name}-{claim.verdict.replace(' ', '-')}"


def write(found: Sequence[Found], options: Options) -> None:
    """Put what was measured into `claims.toml` (numbers and verdict of each entry) and onto the page."""
    text = FILE.read_text()
    for each in found:
        if each.values:
            values = {
                "measured": _rounded(_median(each.values)),
                "spread": [_rounded(min(each.values)), _rounded(max(each.values))],
                "starts": len(each.values),
                "verdict": each.verdict,
            }
            begin = re.search(rf"^\[{each.claim.name}\]$", text, re.MULTILINE).start()  # type: ignore[union-attr]
            stop = text.find("\n[", begin + 1)
            entry = text[begin : stop if stop > 0 else None]
            for key, value in values.items():
                entry, count = re.subn(rf"^{key} = .*$", f"{key} = {_toml(value)}", entry, flags=re.MULTILINE)
                if count != 1:
                    raise ValueError(f"[{each.claim.name}] has {count} lines {key} = ...")
            text = text[:begin] + entry + (text[stop:] if stop > 0 else "")
    FILE.write_text(text)
    write_page()


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _toml(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value)


def write_page() -> None:
    """Renew the tables of `docs/claims.md`, each between its two marks."""
    claims, text = read_claims(), PAGE.read_text()
    for system in dict.fromkeys(claim.system for claim in claims.values()):
        begin, end = f"<!-- claims of {system} -->\n", f"<!-- end of {system} -->"
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        text = f"{before}{begin}\n{page_table(claims, system)}\n{end}{after}"
    PAGE.write_text(text)


def write_figures(found: Sequence[Found], options: Options) -> Path:
    """Write every value of what was measured to `claims.json` among the figures."""
    path = options.figures / "claims.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = json.loads(path.read_text()) if path.exists() else {}
    for each in found:
        if each.values:
            stored[each.claim.name] = finite(
                {"values": each.values, "unit": each.claim.unit, "bar": each.claim.bar(), "verdict": each.verdict,
                 "machine": each.machine}
            )  # fmt: skip
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in stored.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    return path


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(prog="python -m validation.claims", description=(__doc__ or "").split("\n\n")[0])
    made.add_argument("claim", nargs="*", help="claims, or systems, to measure; all by default")
    made.add_argument("--quick", action="store_true", help="small sizes, where they can judge")
    made.add_argument("--jobs", type=int, default=1, help="processes; each computes on one thread")
    made.add_argument("--backend", default="cpu", help="numpy, cpu (default) or cuda")
    made.add_argument("--fresh", action="store_true", help="compute anew what is stored")
    made.add_argument(
        "--write", action="store_true", help="write what was measured into claims.toml and docs/claims.md"
    )
    made.add_argument("--results", type=Path, default=Path("results"), help="where results are kept and reused")
    made.add_argument("--figures", type=Path, help="where claims.json goes; figures, with --quick figures/quick")
    made.add_argument("--list", action="store_true", help="list the claims")
    return made


def chosen(names: Sequence[str], claims: Mapping[str, Claim]) -> list[Claim]:
    """Claims by their names or their systems'; all without names. Raises InputError for a name that there is not."""
    systems = {claim.system for claim in claims.values()}
    for name in names:
        if name not in claims and name not in systems:
            raise InputError(f"There is no claim or system {name!r}; python -m validation.claims --list names them.")
    return [claim for claim in claims.values() if not names or claim.name in names or claim.system in names]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 0 well, 2 bad input, 4 where a written verdict does not hold."""
    given = parser().parse_args(arguments)
    try:
        claims = chosen(given.claim, read_claims())
        if given.list:
            for claim in claims:
                print(f"{claim.system:16}  {claim.name:32}  {claim.verdict:12}  {claim.what or claim.says}")
            return EXIT_FINE
        if given.write and given.quick:
            raise InputError("claims: --write takes the published sizes; leave --quick out.")
        figures = given.figures or Path("figures/quick" if given.quick else "figures")
        options = Options(
            quick=given.quick, backend=given.backend, fresh=given.fresh, results=given.results, figures=figures
        )
        found = measure(claims, options, given.jobs)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    write_figures(found, options)
    if given.write:
        write(found, options)
        found = [
            Found(claim, each.values, each.missing) for claim, each in zip(chosen(given.claim, read_claims()), found)
        ]
    print(table(found))
    for why in dict.fromkeys(each.missing for each in found if each.missing):
        names = ", ".join(each.claim.name for each in found if each.missing == why)
        print(f"not measured: {names} ({why})")
    return EXIT_FINE if all(each.holds for each in found) else EXIT_FAILED


if __name__ == "__main__":
    from validation.claims import main as run  # this module under its own name, as the cases know it

    sys.exit(run())
