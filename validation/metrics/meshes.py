"""What the triangles of a mesh are like."""

from typing import Any

import numpy as np


def eigenvalues(matrix: Any) -> np.ndarray:
    """Eigenvalues of Lambda B^T B in ascending order."""
    dense = matrix.toarray()
    root = np.sqrt(1 / dense.sum(0))
    return np.linalg.eigvalsh(root[:, None] * (dense.T @ dense) * root[None, :])


def smallest_angles(vertices: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Smallest angle of each triangle [degrees]; 0 where two corners coincide."""
    corner = vertices[facets]
    angle = np.full(len(facets), 180.0)
    for k in range(3):
        u, v = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
        size = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        cosine = (u * v).sum(1) / np.where(size > 0, size, 1.0)
        angle = np.minimum(angle, np.where(size > 0, np.degrees(np.arccos(np.clip(cosine, -1, 1))), 0.0))
    return angle


def neighbouring_facets(facets: np.ndarray) -> np.ndarray:
    """Pairs of triangles that share an edge (edges, 2)."""
    side = np.sort(np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(facets)), 3)
    order = np.lexsort(side.T)
    return owner[order].reshape(-1, 2)


def edge_counts(facets: np.ndarray) -> tuple[int, int]:
    """(edges, edges that are not in exactly two triangles, once in each direction)."""
    directed = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]]).astype(np.int64)
    code = directed[:, 0] * (facets.max(initial=0) + 1) + directed[:, 1]
    back = directed[:, 1] * (facets.max(initial=0) + 1) + directed[:, 0]
    known, times = np.unique(code, return_counts=True)
    edges = len(np.unique(np.minimum(code, back)))
    return edges, int((times != 1).sum() + (~np.isin(back, known)).sum())
