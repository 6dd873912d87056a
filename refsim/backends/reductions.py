"""Largest numbers and counts over all rows, of bodies that give them for each row (`reduction`).

On a CPU each chunk of the rows has its own; a GPU reduces in each block of threads, then by one atomic for each block.
Neither maxima nor counts (up to 2^24 in float32) depend on the order of the blocks, so that results repeat bit for bit.
"""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim.backends.compile import THREADS_PER_BLOCK, Kernel, formula, marks, overloaded

LEAST = -(2.0**100)  # below all numbers whose maxima may be negative; what is left where there are no rows
CHUNKS = 64  # in which rows are summed, whatever the threads: a sum does not depend on them
CPU = """\
def of_chunk(chunk, {given}, {into}):
    begin, end = limits(chunk, {rows}.shape[0])
    {zeros}
    for i in range(begin, end):
        {values} = body(i, {given})
        {reduced}
    {written}


def {name}({given}, {into}):
    over_rows(of_chunk, {into}.shape[0], ({given}, {into}))
"""
CUDA = """\
def {name}({given}, {into}):
    {zeros}
    {own_rows}
        {values} = body(i, {given})
        {reduced}
    # The numbers only grow: one that is read too early costs a reduction of this block and nothing else.
    if cuda.syncthreads_or(np.int32({grown})) == 0:
        return
    {written}
"""
PARTED_CPU = """\
def of_chunk(chunk, {given}, {into}):
    begin, end = limits(chunk, {rows}.shape[0])
    for i in range(begin, end):
        part, {values} = body(i, {given})
        {reduced}


def {name}({given}, {into}):
    over_rows(of_chunk, {into}.shape[0], ({given}, {into}))
"""
PARTED_CUDA = """\
def {name}({given}, {into}):
    for part in range({into}.shape[0]):
        {zeros}
        {own_rows}
            own, {values} = body(i, {given})
            if own == part:
                {reduced}
        if cuda.syncthreads_or(np.int32({grown})) != 0:
            {written}
"""
LARGEST = """\
shared{k} = cuda.shared.array(THREADS_PER_BLOCK, {into}.dtype)
most{k} = largest_of_block(shared{k}, s{k})
if cuda.threadIdx.x == 0 and most{k} > {into}[{at}]:
    cuda.atomic.max({into}, {at}, most{k})
"""
COUNT = """\
count{k} = cuda.syncthreads_count(1 if s{k} else 0)
if cuda.threadIdx.x == 0 and count{k} > 0:
    cuda.atomic.add({into}, {k}, {into}.dtype.type(count{k}))
"""


class Reduction(Kernel):
    """What one row does and gives, written once, and the programs that reduce the numbers over all rows.

    into  the programs' last argument, an array of the reduced numbers, which the body does not take
    how   "largest" (of numbers of 0 or more; a GPU leaves out NaN) or "count" (of flags) for each number in turn
    rows  argument with as many rows as there are, or "group.member"

    With `looping` a thread of a GPU takes several rows, whose maxima then cost fewer atomics; not for counts. With
    `parted` the body gives first the row of `into` to which its numbers belong, and their maxima may be negative.
    """

    def __init__(
        self, function: Callable, *, into: str, how: str, rows: str, looping: bool = False, parted: bool = False
    ) -> None:
        super().__init__(function)
        self.parted, self.least = parted, LEAST if parted else 0
        self.into, self.how, self.body_arguments = into, how.split(), self.arguments
        self.arguments, self.rows = [*self.body_arguments, into], into
        self.options["cuda"] |= {"rows_of": rows, "looping": looping}
        signature = inspect.signature(function)
        last = inspect.Parameter(into, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        self._signature = signature.replace(parameters=[*list(signature.parameters.values())[1:], last])
        self._programs: dict[str, Callable] = {}

    def source(self, backend: str) -> str:
        """The loop around the body; on a CPU it sets the numbers of each chunk."""
        on_cpu, into, kinds = backend == "cpu", self.into, list(enumerate(self.how))
        zero = {"largest": f"{into}.dtype.type({self.least})", "count": "0" if on_cpu else "False"}
        step = {"largest": "max(s{k}, t{k})" if on_cpu else "t{k} if t{k} > s{k} else s{k}"}
        step["count"] = "s{k} + t{k}" if on_cpu else "t{k}"
        at = "part, {k}" if self.parted else "{k}"
        grows = [f"s{k}" if kind == "count" else f"s{k} > {into}[{at.format(k=k)}]" for k, kind in kinds]
        last = dict.fromkeys(zero, "{into}[chunk, {k}] = s{k}") if on_cpu else {"largest": LARGEST, "count": COUNT}
        rows = self.options["cuda"]["rows_of"]
        one_row = ["i = cuda.grid(1)", f"if i < {rows}.shape[0]:"]
        several = [f"for i in range(cuda.grid(1), {rows}.shape[0], cuda.gridsize(1)):"]
        lines = {
            "own_rows": several if self.options["cuda"]["looping"] else one_row,
            "zeros": [f"s{k} = {zero[kind]}" for k, kind in kinds],
            "reduced": [f"s{k} = {step[kind].format(k=k)}" for k, kind in kinds],
            "written": [
                line for k, kind in kinds
                for line in last[kind].format(k=k, into=into, at=f"({at.format(k=k)})").splitlines()
            ],
        }  # fmt: skip
        if self.parted and on_cpu:
            lines["reduced"] = [f"{into}[chunk, part, {k}] = max({into}[chunk, part, {k}], t{k})" for k, _ in kinds]
        template = (PARTED_CPU if on_cpu else PARTED_CUDA) if self.parted else CPU if on_cpu else CUDA
        return filled_in(
            template,
            lines,
            name=self.__name__,
            given=", ".join(self.body_arguments),
            into=into,
            rows=rows,
            values=", ".join(f"t{k}" for k, _ in kinds),
            grown=" or ".join(grows),
        )

    def program(self, backend: str) -> Callable:
        """What sets the numbers; of a GPU's, `cleared` does only what remains where they are zero already."""
        if backend not in self._programs:
            self._programs[backend] = made = self._program(self._on_cuda if backend == "cuda" else self._on_cpu)
            if backend == "cuda":
                made.cleared = self._program(self.on("cuda"))  # type: ignore[attr-defined]
        return self._programs[backend]

    def _program(self, run: Callable) -> Callable:
        """A function of the body's arguments and `into`."""

        @functools.wraps(self.__wrapped__)
        def program(*values: Any) -> None:
            run(*values)

        program.__signature__, program.into, program.least = self._signature, self.into, self.least  # type: ignore[attr-defined]
        return program

    def _on_cpu(self, *values: Any) -> None:
        *given, out = values
        partial = np.full((CHUNKS, *out.shape), self.least, out.dtype)
        self.on("cpu")(*given, partial)
        out[:] = partial.max(0)
        for k, kind in enumerate(self.how):
            if kind == "count":
                out[k] = partial[:, k].sum(0)

    def _on_cuda(self, *values: Any) -> None:
        from refsim.backends import device  # loads numba.cuda

        device.fill(values[-1], self.least)
        self.on("cuda")(*values)

    def _named(self, backend: str) -> dict[str, Any]:
        names = {**super()._named(backend), "limits": limits}
        if backend == "cuda":
            from refsim.backends.primitives import largest_of_block

            names |= {"largest_of_block": largest_of_block, "THREADS_PER_BLOCK": THREADS_PER_BLOCK, "np": np}
        return names

    def wrapper(self, backend: str) -> Callable:
        function = super().wrapper(backend)
        if backend == "cpu":
            loop = function.__globals__["of_chunk"]
            overloaded(loop, lambda *types: loop, ("cpu",), forceinline=True, _nrt=False)
        return function


reduction = marks(Reduction)


@formula
def limits(chunk: int, rows: int) -> tuple[int, int]:
    """First row of a chunk, and the end."""
    return chunk * rows // CHUNKS, (chunk + 1) * rows // CHUNKS


def filled_in(template: str, lines: Mapping[str, list[str]], **words: str) -> str:
    """The template with words in its lines, and with several lines, or none, in place of a line."""
    text = []
    for line in template.splitlines():
        name = line.strip()[1:-1]
        if line.strip() == f"{{{name}}}" and name in lines:
            text += [line[: len(line) - len(line.lstrip())] + part for part in lines[name]]
        else:
            text.append(line.format(**words))
    return "\n".join(text) + "\n"
