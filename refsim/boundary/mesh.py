"""Triangle meshes as boundaries: `refsim.scene.surface_mesh` under the name that scripts import."""

from refsim.scene.surface_mesh import SurfaceMesh as SurfaceMesh
from refsim.scene.surface_mesh import areas as areas
from refsim.scene.surface_mesh import load_mesh as load_mesh
from refsim.scene.surface_mesh import signed_volume as signed_volume
from refsim.scene.surface_mesh import surface_mesh as surface_mesh
