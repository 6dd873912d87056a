"""Triangle meshes as boundaries: `refsim.scene.surface_mesh` under the name that scripts import."""

from refsim.scene.surface_mesh import SurfaceMesh, areas, load_mesh, signed_volume, surface_mesh

__all__ = ["SurfaceMesh", "areas", "load_mesh", "signed_volume", "surface_mesh"]
