"""What one point does for the winding number."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import three
from refsim.winding_number.formulas import winding_at


@kernel
def winding(i, viewpoint, clusters, winding_number):
    """Jacobson eq. 5 with Barill eq. 4: winding number about a point, dimensionless."""
    winding_number[i] = winding_at(three(viewpoint, i), clusters)
