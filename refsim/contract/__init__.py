"""The contract that every program of every operation keeps, as steps of one ladder."""

from refsim.contract.inputs import Inputs, bindings

__all__ = ["Inputs", "bindings"]
