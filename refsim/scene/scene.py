"""A scene: particles and a list of effects, with what a run needs to know of space and time."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec

from refsim.core.checked import Checked, NotNegative, Positive, plainly, suggestion
from refsim.core.effect import Effect
from refsim.core.errors import InputError
from refsim.gauges import Gauge
from refsim.motion import Motion
from refsim.neighbours.limits import SKINS
from refsim.scene.shapes import Ball, Box, Cloud, FluidMesh, Vector
from refsim.scene.solids import SolidBall, SolidBox, SolidCells, SolidMesh, SolidTorus


class Scene(Checked, frozen=True, kw_only=True):
    """Everything a run needs, in SI units.

    spacing         initial particle distance d [m]
    support_radius  radius h beyond which the smoothing kernels vanish [m]; at least one spacing, and
                    1.05 where an effect sums over neighbours
    fluid           boxes, balls, insides of meshes and clouds of particles
    solid           boxes, balls, tori, meshes and cells that become bodies of particles; they come before the fluid's
    effects         what acts on them
    dim             2 (z = 0, masses per metre of depth) or 3
    dtype           "float32" or "float64"
    end_time        where `refsim run` stops [s]
    step            fixed step [s]; 0 lets the stable step decide
    step_factor     share of the stable step that is taken
    skin            share of the support radius by which the neighbour list reaches further; by default 0.1, on a CPU
                    0.2 while lists serve few steps; 0.05 (GPU: 0.02) where particles rest or cross skins in a step
    period          lengths of a periodic box along x, y and z [m]; 0 along axes without a period
    period_lower    lower corner of that box [m]
    motion          how gravity or faces of walls move in time
    gauge           what is measured in the run, each a series in time
    name            title in reports
    """

    spacing: Positive
    support_radius: Positive
    fluid: tuple[Box | Ball | Cloud | FluidMesh, ...]
    solid: tuple[SolidBox | SolidBall | SolidTorus | SolidMesh | SolidCells, ...] = ()
    effects: tuple[Any, ...] = ()
    dim: Literal[2, 3] = 3
    dtype: Literal["float32", "float64"] = "float32"
    end_time: NotNegative = 1.0
    step: NotNegative = 0.0
    step_factor: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    skin: NotNegative | None = None
    period: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    period_lower: Vector = (0.0, 0.0, 0.0)
    motion: tuple[Motion, ...] = ()
    gauge: tuple[Gauge, ...] = ()
    name: str = "scene"

    @property
    def skins(self) -> tuple[float, ...]:
        """Skins that lists of a run take, the first one at first; in a periodic box, whose lists are short, one."""
        return SKINS[: 1 if any(self.period) else None] if self.skin is None else (self.skin,)

    @plainly
    def with_(self, **changes: Any) -> "Scene":
        """This scene with other values, which are checked like those of a new one.

        changes  by name: a field of the scene, `spacing=0.01`; a parameter of an effect,
                 `gravity__acceleration=(0.0, -1.6, 0.0)`; of a part, counted from 0, `fluid__0__radius=0.1`

        Raises InputError where there is no such field, effect, part or parameter.
        """
        scene, effects = self, [effect.name for effect in self.effects]
        fields = [*self.__struct_fields__, *(f"{name}__" for name in effects)]
        for path, value in changes.items():
            place, *inner = path.split("__")
            of_effect = inner and place not in self.__struct_fields__
            keys = ["effects", place] if of_effect else [_known(path, place, fields)]
            scene = _changed(path, scene, [*keys, *inner], value)
        return scene


def _known(path: str, name: str, names: Sequence[str]) -> str:
    """`name` if it is one of `names`. Raises InputError otherwise."""
    if name not in names:
        hint = suggestion(name, names) if names else "there are none."
        raise InputError(f"with_({path}=...): this scene has no {name!r} there; {hint}")
    return name


def _changed(path: str, part: Any, keys: Sequence[str], value: Any) -> Any:
    """A part of a scene with another value at the place to which the words lead, through effects by their names."""
    if not keys:
        return value
    word, *inner = keys
    if isinstance(part, tuple):
        names = [getattr(each, "name", "") if isinstance(each, Effect) else str(k) for k, each in enumerate(part)]
        k = names.index(_known(path, word, names))
        return (*part[:k], _changed(path, part[k], inner, value), *part[k + 1 :])
    return msgspec.structs.replace(
        part, **{_known(path, word, part.__struct_fields__): _changed(path, getattr(part, word, None), inner, value)}
    )
