"""CUDA kernel that sums numbers of cells over boxes, one axis after the other."""

from refsim.backends.compile import cuda, cuda_kernel, formula


@formula
def stride_of(axis, side):
    """Distance of neighbouring cells along an axis in memory [cells]."""
    if axis == 0:
        return side[1] * side[2]
    if axis == 1:
        return side[2]
    return 1


@formula
def axis_sum(c, cell, stride, half_width, source, target):
    """Sum of number c over the 2 w + 1 cells around one along an axis, whose cells stand `stride` apart."""
    total = source[c, cell]
    for k in range(1, half_width + 1):
        total += source[c, cell - k * stride] + source[c, cell + k * stride]
    target[c, cell] = total


@cuda_kernel
def sum_axis(axis, half_width, count, side, source, target, node):
    """Sums along one axis around every cell; neighbouring threads read contiguous memory."""
    cell = cuda.grid(1)
    margin = half_width * side[1] * side[2]
    if margin <= cell < node.shape[0] - margin:
        stride = stride_of(axis, side)
        for c in range(count):
            axis_sum(c, cell, stride, half_width, source, target)


def sum_axes(half_width, boxes, count):
    """Sums of the first `count` numbers over the box around every cell, into boxes.second."""
    sum_axis(0, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
    sum_axis(1, half_width, count, boxes.side, boxes.second, boxes.first, boxes.node)
    sum_axis(2, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
