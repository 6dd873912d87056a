"""Injects one slip after another into an operation's programs and asks the contract to notice each.

Run as `NUMBA_DISABLE_JIT=1 python slips.py OPERATION...`: kernels are then Python functions, and a slip is put in by
giving a function the code of its altered source. The operations must share one program. Prints one JSON object, see
`inject`; with `--part K/N` of every Nth slip only. Kinds: sign, factor, index, condition.
"""

import argparse
import ast
import contextlib
import copy
import functools
import inspect
import itertools
import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from unittest import mock

import numpy as np

from refsim.backends import rows
from refsim.contract import Target
from refsim.contract.answers import on_case
from refsim.contract.ladder import climbing
from refsim.core import cases
from refsim.core.errors import RunStopped
from refsim.core.operation import REGISTRY
from refsim.mpm.grid import MpmGrid
from refsim.smoothing import SHAPES, formulas, reference, smoothing
from refsim.sparse_grid import block_search

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
SECONDS = {False: 60, True: 600}  # of processor time, after which a slip has made a trial (shallow, deep) endless
PATIENCE = 10.0  # times the processor time without a slip, plus a second: likewise
SHARED = ("refsim.backends.", "refsim.neighbours.pairs", "refsim.neighbours.rows")  # have tests of their own
FIRST_CASES = ("three_particles", "cloud_2d", "cloud_3d", "printed_readings")

SIZE = "size = w1 * w1 + w2 * w2 + w3 * w3"
FORGOTTEN = "position_residual[i, c] = type(position_residual[i, c])(0)"
DEFORMED = "put(deformation, i, ("
DIAGONAL = ("size", *["real(0)"] * 3, "size", *["real(0)"] * 3, "last")
CLEARED = "scratch[b, n, c] = type(scratch[b, n, c])(0)"
SLOPES = "f0 + w * (f1 - f0), gx / h, gy / h, (f1 - f0) / h"
SIGNS = "return (xn * yt * zt, xt * yn * zt, xt * yt * zn)"
SIDES = ", ".join(f"0 if a{a} == j{a} else 1 if j{a} < low[{k}] else 2" for k, a in enumerate("xyz"))
MIRRORED = f"sx, sy, sz = signs({SIDES}, r)"
CORNER = (
    "there = step_in_block(distance_field, node, c & 1, c >> 1 & 1, c >> 2) if node >= 0 else "
    "find_node(distance_field, jx + (c & 1), jy + (c >> 1 & 1), jz + (c >> 2))"
)
BOX = "x * x + y * y + z * z"
FULL = "formulas.equally_near(best) < real(1)"
NEAR = "reach == 2 and max(abs(dx), max(abs(dy), abs(dz)))"


def wider(reach, end):
    """Slips that look at one layer of cells more, on either side of the cells from -reach to end - 1."""
    ends = ((f"-{reach}", f"{end}"), (f"-{reach} if space else 0", f"{end} if space else 1"))
    more = ((f"-{reach + 1}", f"{end}"), (f"-{reach}", f"{end + 1}"))
    return [
        (f"range({low}, {high})  ->  range({low.replace(f'-{reach}', a)}, {high.replace(f'{end}', b, 1)})", "too far")
        for low, high in ends
        for a, b in more
    ]


LAST = "least, most = (REACH - OFFSET, OFFSET - 1 - REACH)"
NUMBERS, WRAPPED = "numbers = [int(float(length) / side * ", "// even * even for length in period[:3]]"
KEYS = " | cell[:, 1] + OFFSET << BITS | cell[:, 2] + OFFSET"
BEFORE = "i // step % (1 << bits) > 0 and "


def row(k):
    """Left side of the first three sums of row k."""
    return f"sums[{k}, 0], sums[{k}, 1], sums[{k}, 2]"


# function -> (start of the altered line, why it changes no answer)
HARMLESS = {
    "kick_drift": [("squared = type(timestep[0])(0)", "only the type is taken")],
    "tension": [("nx, ny, nz = (real(0)", "set again where they are used")],
    "pair_sums": [("nx, ny, nz = (real(0)", "set again where they are used")],
    "squared_gradient": [(f"g{c} += f * d{c}", "only its square is taken") for c in "xyz"],
    "corrected": [("nx, ny, nz, filled = (real(0)", "zero over anything")],
    "unit": [("zero = type(length)(0)", "a normal without direction is not looked at")],
    "rigid_motion": [
        ("spin = (real(0)", "set again where it is used"),
        ("trace = real(2) * (sums[6] + sums[7] + sums[8])  ->  trace = real(3)", "both sides are divided by it"),
    ],
    "solved": [
        (
            "xx, yy, zz = (a[0] + floor, a[1] + floor, a[2] + floor)"
            "  ->  xx, yy, zz = (a[0] + floor, a[1] + floor, a[2] - floor)",
            "cut off at the floor; the second solution takes back what it changes",
        )
    ],
    "adhesion_pair": [("q <= real(0.5) or q >= real(1)", "beyond the support no pair is looked at")],
    "step_node": [("return -1  ->  return -2", "any negative number says that there is no node")],
    "base_coordinate": [("return FARTHEST + 1  ->  return FARTHEST + 2", "any number beyond all nodes does")],
    "mirrored_update": [
        ("range(3)  ->  range(4)", "a node has no fourth image along an axis"),
        *(
            (
                f"{MIRRORED}  ->  {MIRRORED.replace(upper, upper[:-1] + '3')}",
                "any number but 0 and 1 is the upper mirror",
            )
            for upper in ("jx < low[0] else 2", "jy < low[1] else 2", "jz < low[2] else 2")
        ),
    ],
    "signs": [
        (f"{SIGNS}  ->  {SIGNS[:k]}/{SIGNS[k + 1 :]}", "a sign divides as it multiplies")
        for k, letter in enumerate(SIGNS)
        if letter == "*"
    ],
    "melted_now": [("phase[i] = FLUID", "a zero has no sign")],
    "detach": [("held = 1", "any positive number means that a melted node is in the region")],
    **{name: [("zero = type(", "only the type is taken")] for name in ("damp_sums", "damp_slot", "motion_sums")},
    **{name: [("real = type(", "only the type is taken")] for name in ("goal_sums", "match_member")},
    "nearby_rotation": [
        ("real = type(first[0])", "only the type is taken"),
        ("least = real(0.05)  ->  least = real(0.0505)", "the careful sums answer the same"),
        ("range(8)  ->  range(9)", "the careful sums answer the same"),
        ("w2 = below * (g2 - beside * w3)  ->  w2 = below /", "endless at the end: the careful sums answer"),
        ("w1 = over * (g1 - a * w2 - b * w3)  ->  w1 = over /", "endless at the end: the careful sums answer"),
        *(
            (f"{SIZE}  ->  {SIZE.replace(f'{w} * {w}', f'{w} / {w}')}", "too large: the careful sums answer")
            for w in ("w1", "w2", "w3")
        ),
        ("not size < real(0.25)", "the careful sums answer the same"),
        ("q = (q[0] / size, q[1] / size, q[2] / size, q[3] / size)", "the size is one up to rounding"),
        ("size < real(2) * precision  ->  size < real(3)", "both are far below a step that changes a digit"),
    ],
    "quick_rotation": [
        ("most > least", "the careful sums answer the same"),
        ("near, best = (True, (before", "the rotation of an empty region is not written"),
        ("moments[0] > type(moments[0])(0)", "only the type is taken"),
    ],
    "match_quick": [
        (
            "least = real(SMALL) * matching.spacing + real(16) * position_doubt(s, solid_position, matching)"
            "  ->  least = real(SMALL) * matching.spacing + real(17)",
            "the careful sums answer the same",
        ),
        (
            "least = real(SMALL) * matching.spacing + real(16) * position_doubt(s, solid_position, matching)"
            "  ->  least = real(SMALL) * matching.spacing + real(16) /",
            "the careful sums answer the same",
        ),
        (
            "least = real(SMALL) * matching.spacing + real(16) * position_doubt(s, solid_position, matching)"
            "  ->  least = real(SMALL) /",
            "the careful sums answer the same",
        ),
        ("return quick_rotation(", "the careful sums answer the same"),
    ],
    "match_end": [("real = type(sums[0])", "only the type is taken")],
    **{
        name: [(f"{line}type(solid_position[s, 0])(0))", "of no members")]
        for name, line in (("match_slot", "return nothing_16("), ("match_sums", "sums = nothing_16("))
    },
    "solved_rotation": [("matrix, basis = (np.empty((4, 4)", "a larger work space")],
    "best_rotation": [
        ("real = type(moments[0])", "only the type is taken"),
        ("basis[p, q] = real(p == q)  ->  basis[p, q] = -real(p == q)", "an eigenvector has no sign"),
        ("best = (w / size, i / size, j / size, k / size)", "the size is one up to rounding"),
    ],
    "diagonalised": [
        ("range(8)", "fewer sweeps are enough"),
        ("range(3)  ->  range(4)", "the last row has nothing beyond its diagonal"),
        ("beside, whole = (real(0), real(0))  ->  beside, whole = (real(0), real(1))", "the matrix has entries of one"),
        ("not beside > precision * precision * whole", "the sweeps end where nothing changes"),
        *(
            (f"matrix[{at}] = real(0)  ->  matrix[{at}] = {zero}", "a zero has no sign and no size")
            for at in ("p, q", "q, p")
            for zero in ("-real(0)", "real(0) * 1.01")
        ),
    ],
    "centred": [
        ("real = type(moments[0])", "only the type is taken"),
        ("return ((xx, xy, xz, yx, yy, yz, zx, zy, zz), real(0))", "a zero matrix keeps the rotation before"),
    ],
    "match_write": [
        *(
            (f"{name}[s, c] = zero  ->  {name}[s, c] = {zero}", "a zero has no sign and no size")
            for name in ("region_center", "region_anchor")
            for zero in ("-zero", "zero * 1.01")
        ),
        ("zero = type(sums[0])(0)", "only the type is taken"),
    ],
    "motion_slot": [("return nothing_12(type(", "only the type is taken")],
    "damp_end": [("region_count[s] > 0 and timestep[0] > 0", "of the two lengths of a step both are positive or none")],
    "_mean": [("return float(here.mean()) if len(here)", "without particles an iteration does nothing")],
    "marked_pair": [("found = type(zero)(1)", "only whether a row is idle depends on it")],
    "row_weights": [
        ("one = real(1)", "only whether a row is idle depends on it"),
        ("weight_i, surface_i = (zero, 0)", "belongs to the mode that is not taken"),
        ("base == zero and slope != zero", "looks for idle rows in vain, or not at all"),
    ],
    "sample_counts": [("sample_count[:] = 0", "a zero has no sign")],
    "count_by_block": [("held[c, b] = 0  ->  held[c, b] = -0", "a zero has no sign")],
    "shorten_labels": [("node_label[i] >= 0  ->  node_label[i] >= 1", "a chain with label 0 has ended")],
    "components": [("inside, one = (np.empty(len(blocks.keys), np.uint8), np.empty(1, ", "joined twice is joined")],
    "join_blocks": [
        ("range(3 if bits == 2 else 2)  ->  range(4", "no node is at an end of a fourth axis"),
        ("other >= 0 and inside[other] != NONE  ->  other >= 1", "block 0 is above no other"),
        ("range(64)  ->  range(65)", "number 64 is at the end of no axis"),
    ],
    "label_block": [
        ("found == 64  ->  found == 65", "a full block may be joined node by node"),
        ("found > 0  ->  found > 1", "a lone node of a block has none to be joined to"),
        (
            "inside[b] = NONE if found == 0 else ALL if found == 64 else SOME"
            "  ->  inside[b] = NONE if found == 0 else ALL if found == 65",
            "full blocks may be joined node by node",
        ),
        ("range(low, low + 64)  ->  range(low, low + 65)", "number 64 has none before it along any axis"),
        (
            f"{BEFORE}node_label[i] >= 0 and (node_label[i - step] >= 0)  ->  {BEFORE}node_label[i] >= 1",
            "a node that has label 0 before it is joined along an axis has none before it there",
        ),
    ],
    # the fourth number of a node in `grid_to_particle` is padding; in the plane the third one is zero
    "four": [
        (
            "return (values[n, 0], values[n, 1], values[n, 2], values[n, 3])"
            "  ->  return (values[n, 0], values[n, 1], values[n, 2], values[n, ",
            "padding",
        )
    ],
    "moments": [
        *(
            (f"{row(k)}, sums[{k}, 3] = {right}  ->  {row(k)}, sums[{(k + 1) % 3}, 3] = {right}", "padding")
            for k, right in enumerate(
                (
                    "three_of(z0, a, z1, b, z2, c)",
                    "three_of(z0, s, z1, t, z2, u)",
                    "three_of(z0, r, z1, q, z2, p)",
                    "two_of(z1, b, z2 + z2, c)",
                )
            )
        ),
        *(
            (f"{row(k)}, sums[{k}, 3] = {name}  ->  sums[{k}, 0], sums[{k}, 1], sums[{at}]", "padding, or zero")
            for k, name in enumerate("asr")
            for at in (f"{k}, 2], sums[{(k + 1) % 3}, 3", f"{(k + 1) % 3}, 2")
        ),
    ],
    "load_block": [("values = np.zeros((deep * width * width, 4), ", "wider rows hold the same")],
    "gather_carriers": [("work = np.zeros((4, 4), ", "a larger work space")],
    "gather": [("work = np.zeros((4, 4), ", "a larger work space")],
    "deform": [
        (f"{DEFORMED}{', '.join(DIAGONAL)}))  ->  {DEFORMED}{', '.join((*DIAGONAL[:k], zero))}", "a zero has no sign")
        for k in (1, 2, 3, 5, 6, 7)
        for zero in ("-real(0)", "real(0) * 1.01")
    ],
    "clear": [
        (f"{CLEARED}  ->  scratch[b, n, c] = {zero}", "a zero has no sign and no size")
        for zero in ("-type(", "type(scratch[b, n, c])(0) * 1.01")
    ],
    "collect": [
        (f"zero = type(scratch[0, 0, 0])(0)  ->  zero = type(scratch[{at}])(0)", "only the type is taken")
        for at in ("1, 0, 0", "0, 1, 0", "0, 0, 1")
    ],
    "layer_weights": [
        (f"return (real(1), real(0), real(0))  ->  return (real(1), {rest})", "in the plane only the first is read")
        for rest in ("real(1), real(0)", "real(0), real(1)")
    ],
    "layer_slopes": [
        (f"return (real(0), real(0), real(0))  ->  return (real(0), {rest})", "in the plane only the first is read")
        for rest in ("real(1), real(0)", "real(0), real(1)")
    ],
    "add_gradient": [("range(3)  ->  range(4)", "only layers of the grid are visited")],
    # of sparse grids
    "cell_coordinate": [
        ("scaled = float(x) * inverse_cell - shift", "no program of a CPU shifts the cells"),
    ],
    "find_node": [("return find_node_near(blocks, jx, jy, jz, -1)", "where the search begins")],
    "find_node_near": [
        ("return -1  ->  return -2", "any negative number says that there is no node"),
        ("guess < 0 or guess >= blocks.keys.shape[0]", "whether the guess is looked at first"),
    ],
    "step_in_block": [
        ("return -1  ->  return -2", "any negative number says that there is no node"),
        ("b < 0  ->  b < 1", "nodes of the first block are found by their coordinates as well"),
    ],
    "trilinear": [("phi, gx, gy, gz, _ = trilinear_near(x, y, z, field, ", "where the search begins")],
    "trilinear_near": [
        ("least >= 0  ->  least >= 1", "the first node is found by its coordinates as well"),
        (
            f"return ({SLOPES}, node >> 6)  ->  return ({SLOPES}, node >> 7)",
            "where the next search begins",
        ),
    ],
    "relax": [("parts = (count + PART - 1) // PART  ->  parts = (count + PART + 1)", "a part without rows")],
    "relax_part": [
        ("block = -1", "where the search begins"),
        (
            "range(part * PART, min((part + 1) * PART, count))  ->  range(part * PART, min((part + 2)",
            "a row computed twice is the same",
        ),
    ],
    "count_blocks": [("block_count[t] = blocks_of_triangle(t, triangles, band_grid, -1", "any negative number counts")],
    "triangle_offset": [("ox, oy, oz = (real(0), real(0), real(0))", "set again where they are used")],
    "entry": [("never = real(2)", "any number above one says that there is none")],
    "clipped": [
        ("last = real(-1)  ->  last = real(-2)", "any negative number says so"),
        ("first, last = (real(0), real(1))  ->  first, last = (real(0), real(2))", "cut off at one by its caller"),
    ],
    "forget": [
        (f"{FORGOTTEN}  ->  position_residual[i, c] = {zero}", "zero")
        for zero in ("-type(", "type(position_residual[i, c])(0) * 1.01")
    ],
    "corrected_step": [
        ("begun = real(1)", "only the sign is looked at"),
        ("t < real(1)  ->  t < real(2)", "two says that there is none"),
        ("real = type(timestep[0])", "only the type is taken"),
    ],
    "pair_weight": [("return (real(1), real(0))", "without weights and marks nothing is multiplied with it")],
    "project": [
        ("closest, feature = (-1, 0)  ->  closest, feature = (-1, 1)", "set again where it is used"),
        ("closest, feature = (-1, 0)  ->  closest, feature = (-2, 0)", "any negative number says that there is none"),
        (f"{CORNER}  ->  {CORNER.replace('node >= 0', 'node >= 1')}", "node 0 is found by its coordinates as well"),
        (
            "t = distance_field.closest[there] if there >= 0 else -1"
            "  ->  t = distance_field.closest[there] if there >= 0 else -2",
            "any negative number says that there is none",
        ),
    ],
    "nearest": [
        (f"{BOX} <= best  ->  {BOX.replace('+', '-', 1)} <= best", "a box that is not skipped has no nearer point"),
        (f"{BOX} <= best  ->  {BOX[::-1].replace('+', '-', 1)[::-1]} <= best", "likewise"),
    ],
    "edge_pierces": [
        (f"b = 3 * ((k + 1) % 3)  ->  b = 3 * ((k {other}) % 3)", "the same three edges from their other ends")
        for other in ("- 1", "+ 2")
    ],
    "place": [("one = type(facet_corner[a, 0])(1)", "only the type is taken")],
    "goal_slot": [("zero = type(matching.spacing)(0)", "only filled slots are required")],
    "curvature": [
        (f"curvature[i] = real(0)  ->  curvature[i] = {zero}", "a zero has no sign and no size")
        for zero in ("-real(0)", "real(0) * 1.01")
    ],
    "particle_crowding": [
        (f"wz = (real(1), real(0), real(0))  ->  wz = (real(1), {rest})", "in the plane only the first is read")
        for rest in ("real(1), real(0)", "real(0), real(1)")
    ],
    # of isosurfaces
    "state_at": [
        ("there < 0  ->  there < 1", "the first node is no step above a node of a block, as blocks are in order")
    ],
    "write_facets": [("range(3)  ->  range(4)", "there are three bits")],
    # of the reconstruction of surfaces
    "node_states": [
        ("node_state[i] = 0  ->  node_state[i] = -0", "a zero has no sign"),
        ("range(2)  ->  range(3)", "cells visited twice"),
        ("touches", "the order in which cells are visited"),
        *wider(2, 2),
    ],
    "exit_points": [
        *wider(2, 2),
        ("length = real(towards) * min(farthest, real(1))", "the end outside is in no sphere: cuts off rounding only"),
    ],
    "candidates": [("s, t, c = (u, one - one, a)", "multiplied with a difference that is zero")],
    "throw_darts": [
        ("accepted[k] = REJECTED  ->  accepted[k] = -REJECTED", "a zero has no sign"),
        (
            "theirs < turn or (theirs == turn and other < k)  ->  theirs < turn or (theirs == turn and other >= k)",
            "the mixing is one to one: no two candidates draw the same number",
        ),
        *wider(1, 2),
    ],
    "offsets": [
        ("range(1, 3)  ->  range(1, 4)", "no particle beyond 2 h is taken"),
        ("range(2)  ->  range(3)", "a third turn finds nothing nearer"),
        (f"reach == 2 and {FULL}  ->  reach == 3 and {FULL}", "cells farther away hold no other particle"),
        *(
            (f"{NEAR} < 2  ->  {NEAR.replace('reach == 2', after)} < 2", "the second round visits all cells")
            for after in ("reach != 2", "reach == 3")
        ),
        *(
            (f"range({low}, {high})  ->  range({low}, {high.replace('+ 1', '+ 2')})", "particles there are too far")
            for low, high in (("-reach", "reach + 1"), ("-reach if space else 0", "reach + 1 if space else 1"))
        ),
    ],
    "splines_of_points": [
        (f"fit_splines[r, k] = real(0)  ->  fit_splines[r, k] = {zero}", "a zero has no sign and no size")
        for zero in ("-real(0)", "real(0) * 1.01")
    ],
    "fit_residuals": [
        (f"residual[r] = real(0)  ->  residual[r] = {zero}", "a zero has no sign and no size")
        for zero in ("-real(0)", "real(0) * 1.01")
    ],
    "extents": [("extent[p] = 0  ->  extent[p] = -0", "a zero has no sign"), *wider(1, 2)],
    "positive_roots": [
        ("changes, last = (0, 1)  ->  changes, last = (0, 2)", "only its sign is looked at"),
        ("last = 1  ->  last = 2", "only its sign is looked at"),
        ("last = -1  ->  last = -2", "only its sign is looked at"),
        ("changes += last < 0  ->  changes += last < 1", "it is 1 or -1"),
        ("range(3)  ->  range(4)", "the last coefficient twice is no change of sign"),
    ],
    # of sorting: what is found to be missing is found again once there are blocks, what is lost stops the run
    "write_keys": [
        (f"keys[i] = -1 if lost else key_of(jx, jy, jz, bits)  ->  keys[i] = {key} if lost", "the run stops")
        for key in ("+1", "-2")
    ],
    "by_owner": [("first = np.empty(count + 1, np.int32)  ->  first = np.empty(count + 2", "one end more is not read")],
    "chunks_for": [
        (
            "return min(max(points // LEAST_CHUNK, 1), CHUNKS)  ->  return min(max(points // LEAST_CHUNK, 2)",
            "the order of points in a block is the same for any number of chunks",
        )
    ],
    "find_chunk": [
        ("missing, lost = (0, 0)  ->  missing, lost = (1, 0)", "blocks made anew are the same"),
        ("missing += 1", "any number but zero"),
        ("lost += 1", "any number but zero"),
        ("cell[i] = -1", "found again, or the run stops"),
        ("last, block = (np.int64(-1), np.int64(0))", "no key is so small"),
        ("block = np.int64(-1)  ->  block = np.int64(-2)", "any negative number says that there is none"),
    ],
    # of heat conduction
    "advance": [
        ("change = table[k, 0] * (before[i] - y) - table[k, 1] * y", "with latent heat no stage takes of the start"),
    ],
    "sweep": [("temperature[i] = running  ->  temperature[i] = -running", "both sweeps turn the sign")],
    "one_sided": [("(0, 1)  ->  (0, 2)", "any number but zero is backwards")],
    "pair_exchange": [
        ("scratch.backend.name == 'cuda'", "the colours one after another or in one launch"),
        ("(0, 1)  ->  (0, 2)", "any number but zero is backwards"),
        ("((0, found), (1, found[::-1]))", "no program of a CPU launches a colour"),
    ],
    "exchange_cells": [("", "no program of a CPU launches a colour")],
    "partner": [
        ("other = (turn - place + rounds) % rounds  ->  other = (turn - place - rounds)", "the remainder is the same"),
        (
            "return other if place < other else rounds  ->  return other if place >= other",
            "a pair from its other end; a particle with itself exchanges nothing",
        ),
    ],
    "joined": [
        (
            f"cells = np.concatenate(found) if found else {old}  ->  cells = np.concatenate(found) if found else {new}",
            "no colour",
        )
        for old, new in (
            ("np.zeros((0, 2), np.int32)", "np.zeros((1, 2)"),
            ("np.zeros((0, 2), np.int32)", "np.zeros((0, 3)"),
        )
    ],
    "colours": [
        (
            "begins[1:] = key[1:] != key[:-1]  ->  begins[1:] = (key[1:] != key[:-1]) * 1.01",
            "a flag is any number but zero",
        ),
        ("nothing = xp.zeros(0, dtype=xp.int32)", "of no colour"),
        ("return (nothing, xp.zeros(1, ", "of no colour"),
        *(
            (f"{LAST}  ->  {LAST.replace('- 1', other)}", "keys of cells beyond belong to no other cell")
            for other in ("+ 1", "- 2")
        ),
        ("ends = xp.concatenate((first, xp.full(1, len(members), dtype=first.dtype)))", "one end more is not read"),
        ("axis = next((a for a in range(3) if step[a]))", "every direction has a step along one of three axes"),
    ],
    "_key": [
        (
            f"return cell[:, 0] + OFFSET << 2 * BITS{KEYS}  ->  return cell[:, 0] - OFFSET << 2 * BITS{KEYS}",
            "other numbers in the same order",
        )
    ],
    "cell_numbers": [
        ("length and number < 2 * even  ->  length and number < 2 / even", "the effect refuses such a box first"),
        (
            f"{NUMBERS}(1 + 1e-06)) {WRAPPED}  ->  {NUMBERS}(1 + 1.0099999999999999e-06)) {WRAPPED}",
            "any share above rounding and far below one",
        ),
    ],
    "weigh_and_pack": [("exchanges.count[i] = found  ->  exchanges.count[i] = found * 1.01", "cut off to an integer")],
    "stepped": [
        ("position_residual[i, c] = type(v)(0)  ->  position_residual[i, c] = -type(v)(0)", "zero"),
        ("position_residual[i, c] = type(v)(0)  ->  position_residual[i, c] = type(v)(0) * 1.01", "zero"),
        ("squared = type(timestep[0])(0)", "only the type is taken"),
        (
            "gradient[i] = inverse[i] * residual[i]  ->  gradient[i] = inverse[i] * residual[i] * 1.01",
            "a common factor of all scaled residuals cancels",
        ),
    ],
    "weighed": [("largest = scratch.array('heat largest', 1, ", "a larger work space")],
    "written": [("number = scratch.array('heat number', 1, ", "a larger work space")],
    "run_stages": [("warm = ", "the fourth is not looked at")],
    "planned": [("number = ", "no program of a CPU plans"), ("table = ", "no program of a CPU plans")],
    "plan_chebyshev": [("", "no program of a CPU plans")],
    "chebyshev": [
        ("conduction.planned_passes and scratch.backend.name == 'cuda'", "the planned passes are the same"),
    ],
    "chebyshev_passes": [
        ("return 0  ->  return 1", "one pass is the least"),
        ("not largest_sum < 1000000000000.0", "below, the number of passes is beyond every bound as well"),
        ("return 1 << 30", "beyond every bound"),
    ],
    "chebyshev_stages": [("omega = 1.0", "set in the first pass")],
    "step_ratio": [
        (
            "return real(above / below) if below > 0 else real(0)"
            "  ->  return real(above / below) if below > 0 else real(1)",
            "what it multiplies is zero then",
        )
    ],
    "turned": [("through = real(0)  ->  through = real(1)", "what it multiplies is zero in a reservoir")],
    "solve": [
        ("passes += 1  ->  passes ", "every system ends long before the bound on the passes"),
        ("first, passes = (None, 1)", "every system ends long before the bound on the passes"),
        ("every = ", "further passes are nearer to the solution than required"),
        ("enough = float(conduction.residual) ** 2 * first  ->  enough = float(conduction.residual) ** 3", "likewise"),
    ],
}

NEGATED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
SWAPPED = {
    ast.Add: ("sign", ast.Sub),
    ast.Sub: ("sign", ast.Add),
    ast.Mult: ("factor", ast.Div),
    ast.Div: ("factor", ast.Mult),
}


def functions_behind(operation):
    """The operation's kernel and every function of refsim that it calls, directly or through others."""
    found, waiting = {}, [operation.program("cpu")]
    while waiting:
        function = inspect.unwrap(waiting.pop())
        key = (function.__module__, function.__qualname__)
        if key in found:
            continue
        found[key] = function
        for node in ast.walk(parsed(function)):
            for name in [node.func, *node.args] if isinstance(node, ast.Call) else []:  # some are handed over
                with contextlib.suppress(Exception):
                    called = inspect.unwrap(eval(ast.unparse(name), dict(function.__globals__)))
                    if (
                        inspect.isfunction(called)
                        and called.__module__.startswith("refsim.")
                        and not called.__module__.startswith(SHARED)
                    ):
                        waiting.append(called)
    return list(found.values())


def parsed(function):
    return ast.parse(textwrap.dedent(inspect.getsource(function)))


def sites(tree, flags=False):
    """(kind, number, change) for every place where something can slip: `change` alters node `number` of a copy."""
    nodes = list(ast.walk(tree))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}

    def in_index(node):
        while node in parents:
            above = parents[node]
            if isinstance(above, ast.Subscript) and node is above.slice:
                return True
            if isinstance(above, ast.stmt):
                return False
            node = above
        return False

    names = {n.id for n in nodes if isinstance(n, ast.Name)}
    taken = {n.arg for n in nodes if isinstance(n, ast.arg)}
    other = {"j": "i", "b": "i", "i": "j" if "j" in names else ""}
    for number, node in enumerate(nodes):
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPPED:
            kind, replacement = SWAPPED[type(node.op)]
            yield kind, number, lambda n, r=replacement: setattr(n, "op", r())
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            yield "sign", number, lambda n: setattr(n, "value", ast.UnaryOp(ast.USub(), n.value))
            if not flags:  # 1.01 is 1 there
                yield "factor", number, lambda n: setattr(n, "value", scaled(n.value))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield "sign", number, lambda n: setattr(n, "op", ast.UAdd())
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in NEGATED:
            yield "condition", number, lambda n: n.ops.__setitem__(0, NEGATED[type(n.ops[0])]())
            if isinstance(parents[node], ast.Return):
                yield "factor", number, lambda n: setattr(n, "comparators", [scaled(n.comparators[0])])
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if in_index(node):
                yield "index", number, lambda n: setattr(n, "value", (n.value + 1) % 3)
            else:
                yield "factor", number, lambda n: setattr(n, "value", n.value * 1.01 if n.value % 1 else n.value + 1)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and in_index(node) and other.get(node.id):
            yield "index", number, lambda n: setattr(n, "id", other[n.id])
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and partner(node.id) in taken:
            yield "index", number, lambda n: setattr(n, "id", partner(n.id))


def partner(name):
    """The other particle's field: velocity_j for velocity_i."""
    return {"_i": name[:-2] + "_j", "_j": name[:-2] + "_i"}.get(name[-2:])


def scaled(node):
    return ast.BinOp(node, ast.Mult(), ast.Constant(1.01))


def altered(function, number, change):
    """Code of the function with one node changed, and the changed line's text."""
    tree = parsed(function)
    node = list(ast.walk(tree))[number]
    line = ast.unparse(copy.deepcopy(statement(tree, node)))
    change(node)
    after = ast.unparse(statement(tree, node))
    tree.body[0].decorator_list = []
    ast.fix_missing_locations(tree)
    space = dict(function.__globals__)
    exec(compile(tree, function.__code__.co_filename, "exec"), space)
    return space[function.__name__].__code__, f"{line.splitlines()[0]}  ->  {after.splitlines()[0]}"


def statement(tree, node):
    """The smallest statement around a node, without what is nested in it."""
    around = [s for s in ast.walk(tree) if isinstance(s, ast.stmt) and any(part is node for part in ast.walk(s))]
    best = min(around, key=lambda s: len(list(ast.walk(s))))
    if isinstance(best, (ast.If, ast.While)):
        return ast.Expr(best.test)
    if isinstance(best, ast.For):
        return ast.Expr(best.iter)
    return best


def shapes_agree():
    """Smoothing kernels that no operation takes by default are judged as in test_formulas: by their oracle."""
    for shape in SHAPES:
        for dim in (2, 3):
            kernel = smoothing(shape, 0.7, dim)
            r = 0.7 * np.array([0.0, 0.2, 0.4, 0.4999, 0.5001, 0.503, 0.6, 0.9, 1.0, 1.3])
            for name in ("kernel_value", "kernel_slope", "viscosity_laplacian"):
                own = np.array([getattr(formulas, name)(x, kernel) for x in r])
                other = getattr(reference, name)(r, kernel)
                if not np.abs(own - other).max() <= 1e-13 * np.abs(other).max():
                    return False
    return True


def far_points_stop():
    """Points beyond all blocks and at no place stop a run, as in test_mpm; a trial of the contract has an answer."""
    for far in (1e9, -1e9, np.nan):
        grid = MpmGrid(3, "float64", 2.0)
        try:
            REGISTRY["mpm.cells"].program("cpu")(np.array([[1.0, far, 1.0]]), None, None, grid, np.empty(1, np.int32))
        except RunStopped:
            continue
        return False
    return True


@functools.cache
def programs_with():
    """The operations whose programs call a function, by its name. Those that take the grid have it sort its points."""
    found = {}
    for operation in REGISTRY.values():
        sorting = [REGISTRY["mpm.cells"]] if "grid" in operation.arguments("cpu") else []
        for name in {key(f) for user in (operation, *sorting) for f in functions_behind(user)}:
            found.setdefault(name, []).append(operation)
    return found


def key(function):
    """Name of a function, with its module."""
    return f"{function.__module__}.{function.__qualname__}"


@contextlib.contextmanager
def backwards():
    """Loops of threads run from their last part to the first, points are sorted in chunks of one: no answer changes."""

    def reverse(*ends):
        return reversed(range(*ends))

    backwards_rows = mock.patch.object(rows, "range", reverse, create=True)
    with backwards_rows, mock.patch.object(block_search, "LEAST_CHUNK", 1):
        yield


def noticed(operation, deep, seconds=math.inf):
    """Whether a step of the ladder fails, raises or takes `seconds`. `deep` takes the steps that need more time."""
    variants = [Target(operation, "cpu", "float64", number) for number in range(len(operation.variants))]
    signal.setitimer(signal.ITIMER_PROF, min(seconds, SECONDS[deep]))
    try:
        if not shapes_agree() or (operation.name == "mpm.cells" and not far_points_stop()):
            return True
        for target in variants:
            if not deep and not all(outcome.passed for outcome in climbing(target, ("T1",))):
                return True
        for target in variants:
            for name in (*cases.COMMON, *operation.cases) if deep else FIRST_CASES:
                if not on_case(target, name, lists="all_pairs").passed:
                    return True
            if deep and not all(outcome.passed for outcome in climbing(target, ("T4", "T5", "T7", "T9"))):
                return True
        if deep:
            with backwards():
                return not all(
                    on_case(target, name, lists="all_pairs").passed
                    for target in variants
                    for name in ("cloud_2d", "cloud_3d")
                )
    except Exception:
        return True
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return False


def too_long(number, frame):
    raise TimeoutError("this trial does not end")


def planted(operation):
    """(function, kind, number, change) for every slip of an operation's program."""
    for function in functions_behind(operation):
        for site in sites(parsed(function), bool(operation.exact)):
            yield function, *site


def inject(operations, part=0, parts=1):
    """Every slip of `planted` in the program that the operations share; of `parts` parts, one.

    {"noticed": {operation: {kind: number}}, "functions": {name: {"planted": {kind: number}, "survived": [slips that no
    operation with the same function notices]}}}. Slips that change no answer are looked for in few cases only.
    """
    limits = {}
    for operation, deep in itertools.product(operations, (False,) if part else (False, True)):
        begun = time.process_time()
        assert not noticed(operation, deep), f"{operation.name} fails before any slip"
        limits[operation.name, deep] = 1 + PATIENCE * (time.process_time() - begun)
    users = programs_with()  # while every function's source can still be read
    caught, found = {operation.name: {} for operation in operations}, {}
    for function, group in itertools.groupby(list(planted(operations[0]))[part::parts], key=lambda slip: slip[0]):
        right, of = function.__code__, found.setdefault(key(function), {"planted": {}, "survived": []})
        others = [operation for operation in users[key(function)] if operation not in operations]
        for _, kind, number, change in group:
            of["planted"][kind] = of["planted"].get(kind, 0) + 1
            code, words = altered(function, number, change)
            slip = f"{function.__name__}: {words}"
            steps = ((others, False),) if harmless(slip) else ((others, False), (operations, True), (others, True))
            function.__code__ = code
            try:
                by = [operation for operation in operations if noticed(operation, False, limits[operation.name, False])]
                for operation in by:
                    caught[operation.name][kind] = caught[operation.name].get(kind, 0) + 1
                if not by and not any(
                    noticed(operation, deep, limits.get((operation.name, deep), math.inf))
                    for among, deep in steps
                    for operation in among
                ):
                    of["survived"].append(slip)
            finally:
                function.__code__ = right
    return {"noticed": caught, "functions": found}


def together(answers):
    """(number planted by kind, slips that survived) of what `inject` says about several functions or parts."""
    made = {}
    for answer in answers:
        for kind, number in answer["planted"].items():
            made[kind] = made.get(kind, 0) + number
    return dict(sorted(made.items())), [slip for answer in answers for slip in answer["survived"]]


def harmless(slip):
    """Whether a slip is known to change no answer."""
    return any(slip.startswith(f"{function}: {line}") for function, lines in HARMLESS.items() for line, _ in lines)


def programs():
    """Names of the operations that share a program, by program."""
    found = {}
    for name, operation in REGISTRY.items():
        found.setdefault((operation.folder, operation.function), []).append(name)
    return list(found.values())


def judged(names, part=0, parts=1):
    """`inject` in a process of its own. Raises RuntimeError if it fails."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    command = [sys.executable, __file__, *names, "--part", f"{part}/{parts}"]
    environment = dict(os.environ, NUMBA_DISABLE_JIT="1", PYTHONPATH=path)
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(f"{'+'.join(names)}: {done.stderr}")
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("operations", nargs="*", metavar="OPERATION", help="operations that share one program")
    parser.add_argument("--part", default="0/1", metavar="K/N", help="slips K, K + N, K + 2 N, ...")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    cases.discover()
    signal.signal(signal.SIGPROF, too_long)
    operations, part = [REGISTRY[name] for name in given.operations], map(int, given.part.split("/"))
    print(json.dumps(inject(operations, *part)))


if __name__ == "__main__":
    main()
