"""Pictures in 3D by PyVista, off screen: surfaces or particles."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from refsim.core.errors import extra
from refsim.core.stopping import held_back
from refsim.render.looks import Camera, Cut, level_axes

SUPERSAMPLING = 2  # pixels along a pixel's edge that are drawn and averaged
BOTTOM, TOP, SIDES = 0.13, 0.09, 0.04  # shares of a picture that are left to its labels
LIGHT = (-0.45, 0.35, 0.82)  # towards the light: right of the viewer, away from him on the ground, up
OPACITY, LAYERS = 0.45, 6  # of clear liquid; surfaces of it that depth peeling draws one behind the other
# Ambient and diffuse light on a body: shaded by its form; mildly, so that its colours can be read; not at all.
SHADED, MILD, FLAT = (0.24, 0.90), (0.70, 0.30), (1.0, 0.0)


def pyvista() -> Any:
    """PyVista without a window. Raises InputError where it is not installed."""
    with held_back():  # modules of VTK that are interrupted while they import each other raise ImportError
        module = extra("pyvista", "a picture in 3D")
        from vtkmodules.vtkCommonCore import vtkObject

        _ = module.Plotter  # PyVista imports its drawing where it is first named
    vtkObject.GlobalWarningDisplayOff()  # software drivers report what they lack
    return module


@dataclass
class Body:
    """Something to be seen: a closed surface, or balls."""

    points: NDArray  # (n, 3) [m], vertices or centres
    facets: NDArray | None  # (f, 3) triangles, counter-clockwise as seen from outside; None for balls
    colour: ArrayLike  # one for all, or (n, 3), each 0 to 1
    radius: float = 0.0  # of balls [m]
    water: bool = False  # seen through
    gloss: float = 0.3  # 0 for matt to 1
    edges: bool = False  # whether sharp edges are kept; else shading is smooth everywhere
    light: tuple[float, float] = SHADED  # SHADED, MILD or FLAT


@dataclass
class Stage:
    """What all pictures of a series share."""

    low: NDArray  # corner (3,) [m] of what is seen
    high: NDArray
    up: NDArray  # (3,) unit vector
    camera: Camera
    size: tuple[int, int]  # of a picture in pixels
    box: tuple[NDArray, NDArray] | None = None  # corners of a tank whose edges are drawn
    background: str = "white"
    half_height: float | None = None  # of what is shown [m]; if None, all that is seen, and space for labels
    finer: int = SUPERSAMPLING  # pixels along a pixel's edge that are averaged; 1 is faster, with smoothed edges
    window: Any = None  # PyVista's, within `kept`

    def frame(self) -> tuple[NDArray[np.float64], float]:
        """Middle of the picture [m] and half of its height [m]."""
        if self.half_height is not None:
            return 0.5 * (self.low + self.high), self.half_height
        right, upward, _ = self.camera.axes(self.up)
        corners = np.array([np.where(pick, self.high, self.low) for pick in np.ndindex(2, 2, 2)])
        across, along = corners @ right, corners @ upward
        width, height = self.size
        tall, wide = float(np.ptp(along)) / (1 - BOTTOM - TOP), float(np.ptp(across)) / (1 - 2 * SIDES)
        half = 0.5 * max(tall, wide * height / width) / self.camera.zoom
        middle = 0.5 * (self.low + self.high)
        middle = middle + (0.5 * (across.max() + across.min()) - middle @ right) * right
        middle = middle + (0.5 * (along.max() + along.min()) - middle @ upward) * upward
        return middle - (BOTTOM - TOP) * half * upward, half

    def draw(self, bodies: Sequence[Body]) -> NDArray[np.uint8]:
        """The picture (height, width, 3) of the bodies."""
        return self._images(bodies, self.background)[0]

    def draw_clear(self, bodies: Sequence[Body]) -> NDArray[np.float64]:
        """The picture (height, width, 4), 0 to 1, of the bodies without a background."""
        on_black, on_white = (image / 255.0 for image in self._images(bodies, "black", "white"))
        passed = (on_white - on_black).min(2, keepdims=True).clip(0.0, 1.0)
        opacity = 1.0 - passed
        colour = np.divide(on_white - passed, opacity, out=np.zeros_like(on_white), where=opacity > 0)
        return np.concatenate([colour.clip(0.0, 1.0), opacity], axis=2)

    @contextmanager
    def kept(self) -> Iterator["Stage"]:
        """Keep the window for the pictures that are drawn inside."""
        width, height = (self.finer * n for n in self.size)
        self.window = pyvista().Plotter(off_screen=True, window_size=(width, height), lighting="none")
        self.window.render_window.SetMultiSamples(0)
        self.window.renderer.SetUseFXAA(self.finer == 1)  # else edges are averaged
        if hasattr(self.window.renderer, "SetUseOIT"):
            self.window.renderer.SetUseOIT(False)  # clear facets are drawn in their order
        else:  # VTK before 9.5
            self.window.enable_depth_peeling(LAYERS)
        try:
            self._lights(pyvista(), self.window)
            self._add_tank(pyvista(), self.window)
            middle, half = self.frame()
            _, upward, towards = self.camera.axes(self.up)
            away = 4.0 * float(np.linalg.norm(self.high - self.low)) + 4.0 * half
            camera = self.window.camera
            camera.position, camera.focal_point, camera.up = middle + away * towards, middle, upward
            self.window.enable_parallel_projection()
            camera.parallel_scale = half
            yield self
        finally:
            self.window.close()
            self.window = None

    def _images(self, bodies: Sequence[Body], *backgrounds: str) -> list[NDArray[np.uint8]]:
        """The picture (height, width, 3) of the bodies on each background."""
        from PIL import Image

        with nullcontext() if self.window else self.kept():
            pv, plotter = pyvista(), self.window
            actors = [self._add(pv, plotter, body) for body in bodies if len(body.points)]
            plotter.renderer.ResetCameraClippingRange()
            images = []
            for background in backgrounds:
                plotter.set_background(background)
                plotter.render_window.Render()
                images.append(np.asarray(Image.fromarray(_pixels(plotter.render_window)).reduce(self.finer)))
            for actor in actors:
                plotter.remove_actor(actor, render=False)
            return images

    def _lights(self, pv: Any, plotter: Any) -> None:
        right, _, towards = self.camera.axes(self.up)
        for direction, strength in ((self._to_light(), 0.80), (towards, 0.30), (towards + 0.8 * right, 0.22)):
            light = pv.Light(light_type="scene light", intensity=strength)
            light.positional = False
            light.position, light.focal_point = tuple(direction), (0.0, 0.0, 0.0)
            plotter.add_light(light)

    def _to_light(self) -> NDArray[np.float64]:
        """Unit vector towards the light, from the left and above, somewhat before the viewer."""
        right, _, towards = self.camera.axes(self.up)
        level = towards - (towards @ self.up) * self.up
        length = float(np.linalg.norm(level))
        level = level / length if length > 1e-9 else level_axes(self.up)[0]
        direction = LIGHT[0] * right + LIGHT[1] * level + LIGHT[2] * np.asarray(self.up)
        return direction / np.linalg.norm(direction)

    def _add_tank(self, pv: Any, plotter: Any) -> None:
        """The edges of the tank, for all pictures."""
        if self.box is not None:
            edges = pv.Box(bounds=np.stack(self.box, 1).ravel()).extract_all_edges()
            plotter.add_mesh(edges, color="#8a8f94", line_width=1.2 * self.finer, lighting=False, render=False)

    def _add(self, pv: Any, plotter: Any, body: Body) -> Any:
        """The actor of a body, which the window shows from now on."""
        shares = np.broadcast_to(np.asarray(body.colour, dtype=float), (len(body.points), 3))
        colours = (255 * shares).round().astype(np.uint8)
        facets = body.facets
        if facets is None:
            return self._add_balls(pv, plotter, body, colours)
        if body.water:  # farther facets first: depth peeling takes 30 MB more and several renders
            near = body.points[facets].mean(1) @ self.camera.axes(self.up)[2]
            facets = facets[np.argsort(near, kind="stable")]
        mesh = _polygons(pv, body.points, facets)
        mesh.point_data["colour"] = colours
        with_normals = mesh.compute_normals(
            cell_normals=False, split_vertices=body.edges, consistent_normals=False, auto_orient_normals=False
        )
        return plotter.add_mesh(
            with_normals, scalars="colour", rgb=True, smooth_shading=True, ambient=body.light[0], diffuse=body.light[1],
            specular=body.gloss, specular_power=35.0, show_scalar_bar=False,
            opacity=OPACITY if body.water else 1.0, culling="back" if body.water else None, render=False,
        )  # fmt: skip

    def _add_balls(self, pv: Any, plotter: Any, body: Body, colours: NDArray) -> Any:
        from vtkmodules.vtkRenderingCore import vtkActor
        from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLSphereMapper

        cloud = pv.PolyData(np.asarray(body.points, dtype=np.float32))
        cloud.point_data["colour"] = colours
        cloud.set_active_scalars("colour")
        mapper = vtkOpenGLSphereMapper()
        mapper.SetRadius(body.radius)
        mapper.SetInputData(cloud)
        mapper.SetScalarModeToUsePointData()
        mapper.SetColorModeToDirectScalars()
        actor = vtkActor()
        actor.SetMapper(mapper)
        look = actor.GetProperty()
        look.SetAmbient(body.light[0])
        look.SetDiffuse(body.light[1])
        look.SetSpecular(body.gloss)
        look.SetSpecularPower(35.0)
        plotter.add_actor(actor, render=False)
        return actor


def _polygons(pv: Any, points: NDArray, facets: NDArray) -> Any:
    return pv.PolyData(np.asarray(points, dtype=np.float32), np.insert(np.asarray(facets), 0, 3, axis=1).ravel())


def smoothed(points: NDArray, facets: NDArray) -> NDArray[np.float32]:
    """(v, 3) vertices of a smoother surface of the same volume (windowed sinc filter, Taubin 1995)."""
    mesh = _polygons(pyvista(), points, facets)
    return np.asarray(mesh.smooth_taubin(n_iter=30, pass_band=0.06, boundary_smoothing=False).points)


def cut_closed(points: NDArray, facets: NDArray, cut: Cut, fineness: float) -> tuple[NDArray, NDArray]:
    """(points, facets) of a closed surface cut by a plane and closed there, with triangles up to `fineness` [m]."""
    normal, origin = np.zeros(3), np.zeros(3)
    normal[cut.axis], origin[cut.axis] = -cut.side, cut.place
    mesh = _polygons(pyvista(), points, facets).clip_closed_surface(normal=normal, origin=origin).triangulate()
    if not mesh.n_cells:
        return np.zeros((0, 3)), np.zeros((0, 3), int)
    mesh = mesh.subdivide_adaptive(max_edge_len=fineness, max_n_passes=8)
    return np.asarray(mesh.points), np.asarray(mesh.regular_faces)


def _pixels(window: Any) -> NDArray[np.uint8]:
    """(height, width, 3) of what a window of VTK has drawn, from above."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    width, height = window.GetSize()
    data = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, data, 0)
    return np.asarray(vtk_to_numpy(data)).reshape(height, width, 3)[::-1]


def bar_length(width: float) -> float:
    """A length of 1, 2 or 5 times a power of ten [m] that takes at most a quarter of a picture `width` m wide."""
    power = 10.0 ** math.floor(math.log10(0.25 * width))
    return max(n * power for n in (1, 2, 5) if n * power <= 0.25 * width)
