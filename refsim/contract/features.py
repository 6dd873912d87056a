"""Each feature by itself: variants with one optional argument, where an operation's own have it only beside others."""

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from refsim.contract.answers import CLOUDS, FEW, differs
from refsim.contract.bounds import oracle
from refsim.contract.inputs import Inputs, with_variant
from refsim.core import cases
from refsim.core.operation import REGISTRY, Operation

TURNED = {"period": ("rotation", "angular_momentum")}  # what no answer keeps in a box that does not turn with it


@functools.cache
def extended(name: str) -> Operation:
    """The operation with a variant for each optional argument by itself beside those of the plain one, if it acts."""
    operation = REGISTRY[name]
    plain, variants, broken = operation.variants[0], list(operation.variants), dict(operation.broken)
    own = [present(operation, variant) for variant in operation.variants]
    for feature in operation.optional:
        if feature in own[0] or own[0] | {feature} in own or feature not in frozenset().union(*own):
            continue
        alone = {key: value for key, value in plain.items() if key != feature}
        if _acts(operation, alone, feature):
            having = [operation.broken.get(k, ()) for k, names in enumerate(own) if feature in names or not k]
            lost = {*sum(map(tuple, having), ()), *TURNED.get(feature, ())}
            broken[len(variants)] = tuple(sorted(lost))
            variants.append(alone)
    return replace(operation, variants=tuple(variants), broken=broken)


def present(operation: Operation, variant: Mapping[str, Any]) -> frozenset[str]:
    """Optional arguments that a variant has."""
    return frozenset(n for n in operation.optional if variant.get(n, n) is not None)


def _acts(operation: Operation, variant: Mapping[str, Any], feature: str) -> bool:
    """Whether the reference takes the feature without others, and gives another answer or a further output."""
    cases.discover()
    for case in (FEW[3], CLOUDS[2], *operation.cases):
        inputs = Inputs(cases.CASES[case](), "float64")
        try:
            with np.errstate(all="ignore"):
                answer = oracle(operation, with_variant(inputs, variant))
                plain = oracle(operation, with_variant(inputs, operation.variants[0]))
        except (TypeError, AttributeError, IndexError, KeyError, ValueError):  # it needs another one
            return False
        if answer.keys() != plain.keys() or differs(answer, plain):
            return True
    return False
